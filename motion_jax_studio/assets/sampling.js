// The sampling dialog: model, seed, steps, guidance scale.

const $ = (id) => document.getElementById(id);
const NAMES = { num_steps: "steps", guidance_scale: "guidance scale" };
const MOST_SEED = 2 ** 32 - 1;

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

  // {model, seed, sampling} of the motion that is shown.
  get current() {
    const { mode, live, state } = this.studio;
    if (mode === "live") {
      return { model: live.model?.name, seed: live.choices.seed, sampling: live.choices.sampling ?? {} };
    }
    const { model, seeds, chosen, sampling } = state.project;
    return { model: model.name, seed: seeds[chosen], sampling };
  }

  show() {
    const ability = this.studio.mode === "live" ? "stream" : "multi_prompt";
    this.able = this.studio.models.filter((model) => model.abilities?.includes(ability));
    if (!this.able.length) return this.studio.notes.tell("no model is ready yet", true);
    const { model, seed, sampling } = this.current;
    $("model").replaceChildren(...this.able.map(({ name }) => new Option(name, name)));
    if (this.able.some(({ name }) => name === model)) $("model").value = model;
    $("seed").value = seed ?? "";
    $("sampling-status").textContent = "Empty fields use the model's defaults.";
    this.fields(sampling);
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
    if (mode === "live" && !live.connected) throw new Error("the studio is not connected; try again when it is");
    if (mode === "live") return live.begin({ model: name, seed, sampling });
    const { seeds, chosen } = state.project;
    if (seeds.some((other, take) => other === seed && take !== chosen))
      throw new Error(`another take already has the seed ${seed}`);
    act({ type: "set", fields: { model: { name, id: id ?? "" }, seeds: seeds.with(chosen, seed), sampling } });
  }
}
