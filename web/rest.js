// REST from the page: JSON there, JSON back, and the server's own words where it refuses.

export class Refused extends Error {
  constructor(status, text) {
    super(text);
    this.status = status; // 0 where there was no answer
  }
}

/** What the server answers at /api/v1/`address`; throws Refused. */
export async function rest(address, { method = "GET", body } = {}) {
  const request = { method };
  if (body !== undefined) Object.assign(request, { body: JSON.stringify(body), headers: { "Content-Type": "application/json" } });
  let answer;
  try {
    answer = await fetch(`/api/v1/${address}`, request);
  } catch {
    throw new Refused(0, "The server cannot be reached.");
  }
  const content = await answer.json().catch(() => null);
  if (!answer.ok) throw new Refused(answer.status, reason(content?.detail) ?? `The server answered ${answer.status}.`);
  return content;
}

/** A refusal as a sentence; where an input was wrong, each mistake with its place. */
function reason(detail) {
  if (Array.isArray(detail)) return detail.map(({ loc, msg }) => `${loc.at(-1)}: ${msg}`).join("; ");
  return detail ? `${detail[0].toUpperCase()}${detail.slice(1)}.`.replace(/\.\.$/, ".") : null;
}
