// The fields of the export panel that depend on the format: character, rig, frame rate, T-pose. What there is says the studio.

const $ = (id) => document.getElementById(id);
const FIELDS = { rig: "export-rig", fps: "export-fps", t_pose: "t-pose", character: "export-character" };
const NAMES = { html: "HTML page", png: "PNG strip", jpg: "JPEG strip" };
const LARGEST = 23e6; // bytes of a character that a request can hold

const base64 = (bytes) =>
  new Promise((done, failed) => {
    const reader = new FileReader();
    reader.onload = () => done(reader.result.slice(reader.result.indexOf(",") + 1));
    reader.onerror = () => failed(reader.error);
    reader.readAsDataURL(new Blob([bytes]));
  });

export class ExportChoices {
  // load(): promises {formats: [{name, options, missing}], rigs: [{name, title}]}
  constructor(load) {
    this.load = load;
    this.character = null; // {name, bytes} of the one that is shown
    $("format").onchange = $("export-character").onchange = () => this.draw();
  }

  /** Fills the lists; character: {name, bytes} of the one that is shown, or null for the mannequin. */
  async open(character) {
    if (!this.rigs) {
      const { formats, rigs } = await this.load();
      this.formats = new Map(formats.map((one) => [one.name, one]));
      this.rigs = rigs;
      $("export-rig").replaceChildren(new Option("as it is", ""), ...rigs.map(({ name, title }) => new Option(title, name)));
    }
    if (!$("format").options.length || character?.name !== this.character?.name) this.list(character);
    this.draw();
  }

  // The usual format comes first: a character's own, else BVH; a .vrm is always a character.
  list(character) {
    this.character = character;
    const usual = !character ? "bvh" : /\.vrm$/i.test(character.name) ? "vrm" : "glb";
    const rows = [...this.formats.values()]
      .filter(({ name }) => character || name !== "vrm")
      .sort((a, b) => (b.name === usual) - (a.name === usual) || Boolean(a.missing) - Boolean(b.missing));
    $("format").replaceChildren(
      ...rows.map(({ name, missing }) => new Option((NAMES[name] ?? name.toUpperCase()) + (missing ? " (not installed)" : ""), name)),
    );
    $("export-character").nextElementSibling.textContent = character ? `on ${character.name}` : "";
    $("export-character").parentElement.hidden = !character;
  }

  /** Whether the file is the character. */
  get onCharacter() {
    return Boolean(this.character) && !$("export-character").disabled && $("export-character").checked;
  }

  draw() {
    const { options, missing } = this.formats.get($("format").value);
    for (const [option, id] of Object.entries(FIELDS)) $(id).disabled = !options.includes(option);
    if (this.onCharacter) $("export-rig").disabled = true; // it keeps its own bones
    const mannequin = this.character && $("export-character").disabled;
    $("export-button").disabled = Boolean(missing);
    $("format-note").textContent = missing ?? (mannequin ? "this format has no character: it shows the mannequin; GLB has" : "");
  }

  /** The fields of a request. */
  async read() {
    const request = { format: $("format").value };
    if (!$("export-rig").disabled && $("export-rig").value) request.rig = $("export-rig").value;
    if (!$("export-fps").disabled && $("export-fps").value) request.fps = Number($("export-fps").value);
    if (!$("t-pose").disabled && $("t-pose").checked) request.t_pose = true;
    if (!this.onCharacter) return request;
    const { name, bytes } = this.character;
    if (bytes.byteLength > LARGEST)
      throw new Error(
        `${name} has ${Math.round(bytes.byteLength / 1e6)} MB, at most ${LARGEST / 1e6} are sent to the studio: reduce its ` +
          "textures, or export .npz and run motion-jax render FILE.npz --character",
      );
    return { ...request, character: await base64(bytes) };
  }
}
