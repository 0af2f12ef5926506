// Times and sizes as people write them.

/** 83 s as 1:23, 3683 s as 1:01:23. */
export function clockTime(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  const two = (number) => String(number).padStart(2, "0");
  return hours ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}

/** A date with its time of day; "simulated" where there is none. */
export function dateTime(text) {
  if (!text) return "simulated";
  return new Date(text).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
}

/** Bytes with a fitting unit. */
export function fileSize(bytes) {
  if (bytes < 1e6) return `${Math.max(1, Math.round(bytes / 1e3))} kB`;
  return `${(bytes / 1e6).toFixed(bytes < 1e7 ? 1 : 0)} MB`;
}
