// The page's notes, with as much of a document as they need; tests/studio/server/test_page_parts.py runs this.
import assert from "node:assert/strict";
import { test } from "node:test";

import { statusOf } from "./messages.js";
import { Notes, STEP } from "./notes.js";

class Element {
  children = [];
  classList = { toggle: () => {} };
  append = (...more) => this.children.push(...more);
  prepend = (...more) => this.children.unshift(...more);
  replaceChildren = (...more) => (this.children = more);
  setAttribute = () => {};
  get lastChild() {
    return { remove: () => this.children.pop() };
  }
}
globalThis.document = { createElement: () => new Element() };

function page() {
  const line = new Element(),
    list = new Element(),
    opener = { hidden: true },
    notes = new Notes(line, list, opener);
  return { notes, list, opener, line, shown: () => line.children.map(({ children }) => children[0].textContent) };
}

test("one line is shown, an error before others, and all notes stay in the list", () => {
  const { notes, list, opener, shown } = page();
  notes.tell("lost", true, "connection");
  notes.tell("not learned", false, "words");
  assert.deepEqual(shown(), ["lost"]);
  notes.forget("connection");
  assert.deepEqual(shown(), ["not learned"]);
  notes.tell("another prompt", false, "words");
  assert.deepEqual(shown(), ["another prompt"]);
  notes.forget("words");
  assert.deepEqual(shown(), []);
  assert.deepEqual([list.children.length, opener.hidden, notes.errors], [3, false, ["lost"]]);
});

test("a note ends with its cause: of a topic never by time, of a step with the next one or after some seconds", (context) => {
  context.mock.timers.enable({ apis: ["setTimeout"] });
  const { notes, shown } = page();
  notes.tell("not learned", false, "words");
  notes.tell("mark a span first", true);
  assert.deepEqual(shown(), ["mark a span first"]);
  notes.forget(STEP);
  assert.deepEqual(shown(), ["not learned"]);
  notes.tell("restored", false);
  context.mock.timers.tick(8000);
  assert.deepEqual(shown(), ["not learned"]);
});

test("a note's button does what it says, once", () => {
  const { notes, line, shown } = page();
  let used = 0;
  notes.tell("not learned: yodels", false, "block", { text: "Use “sings”", does: () => (used += 1) });
  line.children[0].children[1].onclick();
  assert.deepEqual([used, shown()], [1, []]);
});

test("without WebSockets the timeline works, and the live motion says why it does not", () => {
  const state = (mode) =>
    statusOf({ mode, live: { absence: "blocked" }, multiPrompt: { busy: null, stale: false }, models: [], blocks: 1 });
  assert.deepEqual(state("timeline"), { text: "ready", is: "good" });
  assert.match(state("live").text, /WebSockets/);
});
