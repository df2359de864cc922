// The sampling dialog: model, seed, steps, guidance scale, and what is done around sampling.

const $ = (id) => document.getElementById(id);
const NAMES = { num_steps: "steps", guidance_scale: "guidance scale" };
const MOST_SEED = 2 ** 32 - 1;
const STEPS = {
  plan: ["split prompts into actions", "off: each prompt goes to the model unchanged"],
  warn: ["notes on words that the model does not know", ""],
  correct: ["spans: keep the legs where only arms and head act", "where new legs would slide"],
  check: ["spans: sample again until the prompt shows", "up to 4 times, the best is kept; off: one pass"],
};
/** The steps of prompts; the others are of marked spans. */
export const STEPS_OF_PROMPTS = ["plan", "warn"];

/** Those of the names of left-out steps that a request takes. */
export const leftOut = (without, names = Object.keys(STEPS)) => (without ?? []).filter((name) => names.includes(name));

/** The number in a field, or null if it is empty. Throws an Error for other text. */
export function read(name, text) {
  const value = Number(text);
  if (!text.trim()) return null;
  if (!Number.isFinite(value)) throw new Error(`got ${name} ${text.slice(0, 20)}, expected a number`);
  return value;
}

/** The seed in a field. */
export function readSeed(text) {
  const seed = read("seed", text);
  if (!Number.isInteger(seed) || seed < 0 || seed > MOST_SEED || !text.trim())
    throw new Error(`got the seed ${text.slice(0, 20) || "nothing"}, expected a whole number from 0 to ${MOST_SEED}`);
  return seed;
}

// A checkbox of a step that may be left out.
function box(name, checked) {
  const [text, title] = STEPS[name];
  const label = Object.assign(document.createElement("label"), { title });
  label.append(Object.assign(document.createElement("input"), { type: "checkbox", name, checked }), text);
  return label;
}

export class Sampling {
  // studio: of main.js
  constructor(studio) {
    this.studio = studio;
    $("sampling").onclick = () => this.show();
    $("model").onchange = () => this.fields({});
    $("sampling-panel").firstElementChild.onsubmit = (event) => {
      if (event.submitter?.value !== "use") return;
      try {
        this.use();
      } catch (error) {
        event.preventDefault();
        $("sampling-status").textContent = error.message;
      }
    };
  }

  // {model, seed, sampling, without} of the motion that is shown.
  get current() {
    const { mode, live, state } = this.studio;
    if (mode === "live") {
      const { seed, sampling = {}, without = [] } = live.choices;
      return { model: live.model?.name, seed, sampling, without };
    }
    const { model, seeds, chosen, sampling, without } = state.project;
    return { model: model.name, seed: seeds[chosen], sampling, without: leftOut(without) };
  }

  show() {
    const ability = this.studio.mode === "live" ? "stream" : "multi_prompt";
    this.able = this.studio.models.filter((model) => model.abilities?.includes(ability));
    if (!this.able.length) return this.studio.notes.tell("no model is ready yet", true);
    const { model, seed, sampling, without } = this.current;
    $("model").replaceChildren(...this.able.map(({ name }) => new Option(name, name)));
    if (this.able.some(({ name }) => name === model)) $("model").value = model;
    $("seed").value = seed ?? "";
    $("sampling-status").textContent = "Empty fields use the model's defaults.";
    this.fields(sampling);
    const names = this.studio.mode === "live" ? STEPS_OF_PROMPTS : Object.keys(STEPS);
    $("sampling-steps").replaceChildren(...names.map((name) => box(name, !without.includes(name))));
    $("sampling-panel").showModal();
  }

  get chosen() {
    return this.able.find(({ name }) => name === $("model").value);
  }

  // A field for each of these that the chosen model has.
  fields(sampling) {
    this.others = Object.fromEntries(Object.entries(sampling).filter(([name]) => !(name in NAMES)));
    const rows = Object.keys(NAMES)
      .filter((name) => name in this.chosen.sampling)
      .map((name) => {
        const { help, usual } = this.chosen.sampling[name];
        const input = Object.assign(document.createElement("input"), { placeholder: usual, inputMode: "decimal" });
        input.name = name;
        input.value = sampling[name] ?? "";
        const label = Object.assign(document.createElement("label"), { title: help });
        label.append(Object.assign(document.createElement("span"), { textContent: NAMES[name] }), input);
        return label;
      });
    $("sampling-fields").replaceChildren(...rows);
  }

  use() {
    const { mode, live, state, act } = this.studio,
      { name, id } = this.chosen,
      seed = readSeed($("seed").value);
    const given = [...$("sampling-fields").querySelectorAll("input")].map((input) => [
      input.name,
      read(NAMES[input.name], input.value),
    ]);
    const sampling = { ...this.others, ...Object.fromEntries(given.filter(([, value]) => value !== null)) };
    const without = [...$("sampling-steps").querySelectorAll("input:not(:checked)")].map((input) => input.name);
    if (mode === "live" && !live.connected) throw new Error("the studio is not connected; try again when it is");
    if (mode === "live") return live.begin({ model: name, seed, sampling, without });
    const { seeds, chosen } = state.project;
    if (seeds.some((other, take) => other === seed && take !== chosen))
      throw new Error(`another take already has the seed ${seed}`);
    act({ type: "set", fields: { model: { name, id: id ?? "" }, seeds: seeds.with(chosen, seed), sampling, without } });
  }
}
