// The fields of the export panel that depend on the format: rig, frame rate, T-pose. What there is says the studio.

const $ = (id) => document.getElementById(id);
const FIELDS = { rig: "export-rig", fps: "export-fps", t_pose: "t-pose" };
const NAMES = { html: "HTML page", png: "PNG strip", jpg: "JPEG strip" };

export class ExportChoices {
  // load(): promises {formats: [{name, options, missing}], rigs: [{name, title}]}
  constructor(load) {
    this.load = load;
    $("format").onchange = () => this.draw();
  }

  /** Fills the lists, the first time. */
  async open() {
    if (!this.formats) {
      const { formats, rigs } = await this.load();
      this.formats = new Map(formats.map((one) => [one.name, one]));
      const first = [...this.formats.values()].sort((a, b) => (b.name === "bvh") - (a.name === "bvh") || Boolean(a.missing) - Boolean(b.missing));
      $("format").replaceChildren(...first.map(({ name, missing }) =>
        new Option((NAMES[name] ?? name.toUpperCase()) + (missing ? " (not installed)" : ""), name)));
      $("export-rig").replaceChildren(new Option("as it is", ""), ...rigs.map(({ name, title }) => new Option(title, name)));
    }
    this.draw();
  }

  draw() {
    const { options, missing } = this.formats.get($("format").value);
    for (const [option, id] of Object.entries(FIELDS)) $(id).disabled = !options.includes(option);
    $("export-button").disabled = Boolean(missing);
    $("format-note").textContent = missing ?? "";
  }

  /** The fields of a request. */
  read() {
    const request = { format: $("format").value };
    if (!$("export-rig").disabled && $("export-rig").value) request.rig = $("export-rig").value;
    if (!$("export-fps").disabled && $("export-fps").value) request.fps = Number($("export-fps").value);
    if (!$("t-pose").disabled && $("t-pose").checked) request.t_pose = true;
    return request;
  }
}
