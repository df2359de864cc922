// Small choices of the user that this browser keeps; null where it stores nothing.

export function stored(name, value) {
  try {
    if (value === undefined) return localStorage.getItem(name);
    localStorage.setItem(name, value);
  } catch {
    // this browser stores nothing
  }
  return null;
}
