// Keyboard shortcuts as in video editors; none while the user types.

const WRITES = "input:not([type=checkbox]):not([type=range]), textarea, select";

/** does: {play, step(frames), home, end, add, choose(by), longer(by), shift(by), edit, remove, undo, redo, markIn, markOut,
    unmark, help, control: {letter: does()} with Ctrl, letters: {letter: does()}} */
export function listen(does) {
  document.addEventListener("keydown", (event) => {
    // Keys of an open dialog are the dialog's, Escape too, wherever the focus is.
    if (event.target.matches?.(WRITES) || event.altKey || document.querySelector("dialog[open]")) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (event.ctrlKey || event.metaKey) {
      if (key === "z" || key === "y") {
        event.preventDefault();
        if (key === "y" || event.shiftKey) does.redo();
        else does.undo();
      } else if (key === "ArrowLeft" || key === "ArrowRight") {
        event.preventDefault();
        does.shift(key === "ArrowLeft" ? -1 : 1);
      } else if (does.control[key] && !String(getSelection())) {
        event.preventDefault();
        does.control[key]();
      }
      return;
    }
    const onButton = event.target.matches?.("button, a, summary"),
      vertical = (way) => (event.shiftKey ? does.longer(-way) : does.choose(way));
    const found = {
      " ": onButton ? null : does.play,
      Enter: onButton ? null : does.edit,
      a: does.add,
      Insert: does.add,
      ArrowUp: () => vertical(-1),
      ArrowDown: () => vertical(1),
      ArrowLeft: () => does.step(event.shiftKey ? -10 : -1),
      ArrowRight: () => does.step(event.shiftKey ? 10 : 1),
      Home: does.home,
      End: does.end,
      Delete: does.remove,
      Backspace: does.remove,
      "[": does.markIn,
      "]": does.markOut,
      Escape: does.unmark,
      F1: does.help,
      ...does.letters,
    }[event.shiftKey && key.length === 1 && `shift-${key}` in does.letters ? `shift-${key}` : key];
    if (!found || (event.target.type === "range" && key.startsWith("Arrow"))) return;
    event.preventDefault();
    found();
  });
  // A clicked button loses the focus, so that the space bar still plays.
  document.addEventListener("click", (event) => {
    if (event.detail) event.target.closest?.("button, label, input[type=checkbox], select")?.blur?.();
  });
}
