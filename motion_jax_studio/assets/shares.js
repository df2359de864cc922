// How much of a request is done: as the studio counts it, else an estimate from how long the last one of its kind took.
// Needs no browser but for what it remembers.

const USUAL = 12, // seconds of a request of which nothing is known
  COMPILES = 45; // and of one that compiles a program first

function remembered(name, seconds) {
  try {
    if (seconds === undefined) return Number(localStorage.getItem(name)) || null;
    localStorage.setItem(name, seconds.toFixed(1));
  } catch {
    return null; // this browser stores nothing
  }
}

/** {of(progress), done()} of one request: of() is its share from 0 to 1, which never falls within a part. */
export function shares(kind, now = () => performance.now() / 1000) {
  const began = now();
  let compiles = false,
    doing = null,
    last = 0;
  const name = () => `seconds of ${kind}${compiles ? ", compiled" : ""}`;
  return {
    of({ doing: part, done, of, seconds }) {
      compiles ||= /^compiling/.test(part);
      if (part !== doing) last = 0;
      doing = part;
      const usual = remembered(name()) ?? (compiles ? COMPILES : USUAL);
      last = Math.max(last, of > 1 ? Math.min(1, done / of) : 1 - Math.exp((-1.5 * seconds) / usual));
      return last;
    },
    done: () => void remembered(name(), now() - began),
  };
}
