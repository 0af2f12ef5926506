// REST from the page: JSON there, JSON back, and the server's own words where it refuses.

export class Refused extends Error {
  constructor(status, text) {
    super(text);
    this.status = status; // 0 where there was no answer
  }
}

/** What the server answers at /api/v1/`address`; throws Refused. `signal` may end the waiting. */
export async function ask(address, { method = "GET", body, signal } = {}) {
  const request = { method, signal };
  if (body !== undefined) Object.assign(request, { body: JSON.stringify(body), headers: { "Content-Type": "application/json" } });
  let answer;
  try {
    answer = await fetch(`/api/v1/${address}`, request);
  } catch {
    throw new Refused(0, "the server cannot be reached");
  }
  const content = await answer.json().catch(() => null);
  if (!answer.ok) throw new Refused(answer.status, reason(content?.detail) ?? `the server answered ${answer.status}`);
  return content;
}

/** Why it refused; where an input was wrong, each mistake with its place. */
function reason(detail) {
  return Array.isArray(detail) ? detail.map(({ loc, msg }) => `${loc.at(-1)}: ${msg}`).join("; ") : detail;
}

/** Words as they stand alone: with a capital letter. */
export function sentence(words) {
  return words[0].toUpperCase() + words.slice(1);
}
