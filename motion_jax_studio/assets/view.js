// What is seen: bodies on a stage, their way and steps on the ground, ghosts, the camera.
// The parts come from viewer.js, the bundle that exported pages hold, too (tools/viewer).

const BLUE = [0.2, 0.5, 0.82],
  ORANGE = [0.93, 0.5, 0.16]; // kept, regenerated
const GHOST_SECONDS = 1,
  MOST_GHOSTS = 14,
  MOST_STEPS = 400,
  LANE = 1.6,
  SLOW = 0.1, // seconds that drawing may take
  COARSEST = 0.5; // pixels drawn for one of the page, across

export class View {
  // element: where the stage is; body: what /body.json says.
  constructor(element, body, dark) {
    this.parts = window.motionParts;
    this.body = body;
    this.stage = new this.parts.Stage(element, { dark, preserve: false });
    this.stage.light(3.5);
    this.options = { follow: true, path: true, steps: true, ghosts: false, sticks: false, edits: true };
    this.turns = new this.parts.Turns(body.names, body.parents, body.rest);
    this.figures = [];
    this.ghosts = [];
    this.character = null; // the body of the user's, instead of the mannequin
    this.world = new this.parts.three.Group(); // what is in the motion's metres, see `size`
    this.size = 1;
    this.stage.scene.add(this.world);
    this.steps = this.makeSteps();
    this.way = null;
    this.turned = true; // the camera, since the last drawing
    this.slow = 0; // drawings one after the other that took long
    this.stage.controls.addEventListener("change", () => {
      this.turned = true;
    });
    this.marks = new this.parts.Marks(); // of constraints
    this.world.add(this.marks.group);
    this.drawing = false; // somebody draws a path: the camera stays where it is
    this.frame();
    new ResizeObserver(() => this.resize()).observe(element);
    this.resize();
  }

  resize() {
    this.stage.resize();
    this.stage.draw();
  }

  // Puts the camera in front of a place of the motion.
  frame(x = 0, z = 0) {
    const { camera, controls } = this.stage,
      distance = 6.2;
    [x, z] = [x * this.size, z * this.size];
    controls.target.set(x, 0.95, z);
    camera.position.set(x + distance * 0.6, 0.95 + distance * 0.25, z + distance * 0.75);
    this.stage.fog(distance + 6, distance + 24);
    controls.update();
  }

  /** Looks at the target from a side ("front", "side", "top") or as a bookmark does. */
  lookFrom(side) {
    const { camera, controls } = this.stage,
      { target } = controls;
    if (typeof side === "object") {
      target.y = side.height;
      camera.position.copy(target).add(side.away);
    } else {
      const distance = Math.min(Math.max(camera.position.distanceTo(target), 4), 9),
        [x, y, z] = { front: [0, 0.1, 1], side: [1, 0.1, 0], top: [0, 1, 0.05] }[side];
      camera.position.set(x, y, z).setLength(distance).add(target);
    }
    controls.update();
    this.turned = true;
  }

  /** The way that the camera looks from now, for `lookFrom`. */
  bookmark() {
    const { camera, controls } = this.stage;
    return { away: camera.position.clone().sub(controls.target), height: controls.target.y };
  }

  makeSteps() {
    const { CircleGeometry, MeshBasicMaterial, InstancedMesh, Color } = this.parts.three;
    const disc = new CircleGeometry(0.055, 20).rotateX(-Math.PI / 2);
    const look = new MeshBasicMaterial({ transparent: true, opacity: 0.75, depthWrite: false });
    const steps = new InstancedMesh(disc, look, MOST_STEPS);
    steps.frustumCulled = false;
    steps.count = 0;
    this.sides = { left: new Color(0x2f8bd0), right: new Color(0xe9703f), now: new Color(0x35b56a) };
    this.world.add(steps);
    return steps;
  }

  // A body of one colour of its own, or sticks where the joints are those of another skeleton.
  makeFigure(count, parents, opacity = 1) {
    const { three, Figure } = this.parts,
      skin = count === this.body.rest.length;
    const own = skin && opacity === 1 ? this.character?.figure(this.body) : null; // ghosts are the mannequin's
    const figure = { count, parents, skin: skin ? (own ?? new Figure(this.body, this.body.colors, { opacity })) : null };
    figure.places = Array.from({ length: count }, () => new three.Vector3());
    figure.turned = Array.from({ length: count }, () => new three.Quaternion());
    const lines = new three.BufferGeometry();
    lines.setAttribute("position", new three.BufferAttribute(new Float32Array(6 * count), 3));
    figure.sticks = new three.LineSegments(lines, new three.LineBasicMaterial({ color: 0x4a90d9 }));
    figure.sticks.frustumCulled = false;
    if (skin) this.world.add(figure.skin.group);
    this.world.add(figure.sticks);
    return figure;
  }

  /** Shows a character (`readCharacter`) from now on; null: the mannequin. */
  wear(character) {
    this.show([]);
    this.character = character;
    this.scale(1); // until it is posed
  }

  // A character is drawn as tall as the mannequin, whatever its legs, and all that is in metres of the motion with it.
  scale(size) {
    if (size === this.size) return;
    const { target } = this.stage.controls;
    this.stage.carry(target.x * (size / this.size - 1), target.z * (size / this.size - 1));
    this.world.scale.setScalar((this.size = size));
    this.world.updateMatrixWorld(true);
  }

  // Joints without a known parent are attached to the root.
  parentsOf(motion, given) {
    if (given?.length === motion.count) return given;
    return motion.count === this.body.parents.length ? this.body.parents : Array(motion.count).fill(0);
  }

  drop(figure) {
    if (figure.skin) {
      this.world.remove(figure.skin.group);
      figure.skin.dispose();
    }
    this.world.remove(figure.sticks);
    figure.sticks.geometry.dispose();
    figure.sticks.material.dispose();
  }

  // motion: as in motion.js; at: a frame that need not be whole; x: how far to the side it stands.
  pose(figure, motion, at, x = 0) {
    const t = Math.max(0, Math.min(Math.floor(at), motion.frames - 1)),
      n = Math.min(t + 1, motion.frames - 1);
    const w = Math.max(0, Math.min(at - t, 1)),
      J = motion.joints,
      count = figure.count;
    for (let j = 0; j < count; j++) {
      const p = 3 * (t * count + j),
        q = 3 * (n * count + j);
      figure.places[j].set(
        J[p] + (J[q] - J[p]) * w + x,
        J[p + 1] + (J[q + 1] - J[p + 1]) * w,
        J[p + 2] + (J[q + 2] - J[p + 2]) * w,
      );
    }
    const bare = this.options.sticks || !figure.skin;
    if (figure.skin) figure.skin.group.visible = !bare;
    figure.sticks.visible = bare;
    if (bare) return this.drawSticks(figure);
    this.turns.set(figure.places, figure.turned);
    figure.skin.put(figure.places, figure.turned);
  }

  drawSticks(figure) {
    const line = figure.sticks.geometry.attributes.position;
    figure.parents.forEach((parent, j) => {
      const a = figure.places[j],
        b = figure.places[Math.max(parent, 0)];
      line.setXYZ(2 * j, a.x, a.y, a.z);
      line.setXYZ(2 * j + 1, b.x, b.y, b.z);
    });
    line.needsUpdate = true;
  }

  // shown: [{motion, at, edited: true, false or null}], side by side; the first one is followed.
  show(shown) {
    while (this.figures.length > shown.length) this.drop(this.figures.pop());
    shown.forEach(({ motion, at, edited, parents }, i) => {
      if (this.figures[i]?.count !== motion.count) {
        if (this.figures[i]) this.drop(this.figures[i]);
        this.figures[i] = this.makeFigure(motion.count, this.parentsOf(motion, parents));
      }
      const figure = this.figures[i];
      this.pose(figure, motion, at, (i * LANE) / this.size);
      if (!i) this.scale(figure.skin?.size ?? 1);
      if (figure.edited !== edited) {
        figure.edited = edited;
        figure.skin?.color(edited === null || edited === undefined ? null : edited ? ORANGE : BLUE);
      }
    });
  }

  /** An empty stage. */
  clear() {
    this.show([]);
    this.removeWay();
    this.prints = [];
    this.steps.count = 0;
    while (this.ghosts.length) this.drop(this.ghosts.pop());
  }

  removeWay() {
    if (!this.way) return;
    this.world.remove(this.way);
    this.way.geometry.dispose();
    this.way.material.dispose();
    this.way = null;
  }

  // What lies on the ground of a motion, up to a frame of it: way, steps, ghosts.
  lay(motion, steps, past = motion.frames) {
    const { three, ribbon } = this.parts;
    this.removeWay();
    if (this.options.path && past > 1) {
      const roots = Array.from({ length: past }, (_, t) => {
        const k = 3 * t * motion.count;
        return [motion.joints[k], motion.joints[k + 2]];
      });
      this.way = ribbon(roots);
      this.world.add(this.way);
    }
    const prints = this.options.steps ? steps.filter((step) => step.first < past).slice(-MOST_STEPS) : [];
    const matrix = new three.Matrix4();
    this.steps.count = prints.length;
    prints.forEach((step, i) => {
      this.steps.setMatrixAt(i, matrix.makeTranslation(step.x, 0.006, step.z));
      this.steps.setColorAt(i, this.sides[step.left ? "left" : "right"]);
    });
    this.steps.instanceMatrix.needsUpdate = true;
    if (this.steps.instanceColor) this.steps.instanceColor.needsUpdate = true;
    this.prints = prints;
    this.layGhosts(motion, past);
  }

  // Steps on which a foot stands at this frame are green.
  light(frame) {
    if (!this.prints?.length || !this.steps.instanceColor) return;
    this.prints.forEach((step, i) => {
      const now = step.first <= frame && frame < step.past;
      this.steps.setColorAt(i, this.sides[now ? "now" : step.left ? "left" : "right"]);
    });
    this.steps.instanceColor.needsUpdate = true;
  }

  layGhosts(motion, past) {
    const step = Math.max(Math.round(GHOST_SECONDS * motion.fps), Math.ceil(past / 40));
    const frames = [];
    if (this.options.ghosts) {
      for (let t = 0; t < past - step / 2; t += step) frames.push(t);
    }
    const wanted = frames.slice(-MOST_GHOSTS);
    while (this.ghosts.length && (this.ghosts.length > wanted.length || this.ghosts[0].count !== motion.count)) {
      this.drop(this.ghosts.pop());
    }
    wanted.forEach((frame, i) => {
      this.ghosts[i] ??= this.makeFigure(motion.count, this.parentsOf(motion), 0.22);
      this.pose(this.ghosts[i], motion, frame);
    });
  }

  /** Draws constraints, as `drawn` of control.js returns them; chosen: the index of a way point. */
  drawConstraints({ poses, ...rest }, chosen = -1) {
    const { three, Figure, PALE } = this.parts;
    const figures = poses
      .filter(({ joints }) => joints.length === this.body.rest.length)
      .map(({ joints }) => {
        const figure = new Figure(this.body, this.body.colors, { opacity: PALE }),
          places = joints.map((place) => new three.Vector3(...place)),
          turned = joints.map(() => new three.Quaternion());
        this.turns.set(places, turned);
        figure.put(places, turned);
        return figure;
      });
    this.marks.set({ ...rest, figures }, { chosen });
  }

  /** The camera looks down at a place [x, z] of the floor, and waits there while a path is drawn. */
  beginDrawing(place = null) {
    const { camera, controls } = this.stage,
      away = camera.position.clone().sub(controls.target),
      distance = Math.max(away.length(), 9);
    if (place) this.stage.carry(place[0] * this.size - controls.target.x, place[1] * this.size - controls.target.z);
    const flat = Math.hypot(away.x, away.z) || 1,
      out = distance * 0.64;
    camera.position.set(
      controls.target.x + (away.x / flat) * out,
      distance * 0.77,
      controls.target.z + (away.z / flat) * out,
    );
    this.stage.fog(distance + 10, distance + 30);
    controls.update();
    this.drawing = this.turned = true;
  }

  /** Where the bones of the first character are drawn, {joint: [x, y, z]} in metres of the motion. */
  places() {
    const found = Object.entries(this.figures[0].skin.places());
    return Object.fromEntries(found.map(([joint, place]) => [joint, place.map((value) => value / this.size)]));
  }

  /** Where on the page a point of the floor is. */
  screenOf(x, z) {
    const box = this.stage.renderer.domElement.getBoundingClientRect(),
      { camera } = this.stage;
    camera.updateMatrixWorld();
    const at = new this.parts.three.Vector3(x, 0, z).multiplyScalar(this.size).project(camera);
    return [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
  }

  /** The point [x, z] of the floor below a point of the page; null where there is none, or farther than `most`. */
  floorAt(left, top, most) {
    const box = this.stage.renderer.domElement.getBoundingClientRect(),
      { camera, controls } = this.stage;
    camera.updateMatrixWorld();
    const ray = new this.parts.three.Vector3(
      ((left - box.left) / box.width) * 2 - 1,
      1 - ((top - box.top) / box.height) * 2,
      0.5,
    )
      .unproject(camera)
      .sub(camera.position);
    if (ray.y >= 0) return null;
    const at = ray.multiplyScalar(-camera.position.y / ray.y).add(camera.position);
    return Math.hypot(at.x - controls.target.x, at.z - controls.target.z) < most ? [at.x / this.size, at.z / this.size] : null;
  }

  /** other: whether something else is to be seen; a picture that stays the same is not drawn again. */
  draw(passed, other) {
    if (this.options.follow && this.figures.length && !this.drawing) {
      const { target } = this.stage.controls,
        easing = Math.min(1, passed * 5);
      const x = (this.size * this.figures.reduce((sum, figure) => sum + figure.places[0].x, 0)) / this.figures.length;
      const z = this.size * this.figures[0].places[0].z;
      this.turned ||= Math.hypot(x - target.x, z - target.z) > 1e-3;
      this.stage.carry((x - target.x) * easing, (z - target.z) * easing);
    }
    if (!other && !this.turned) return void this.stage.controls.update(); // continues the damping of a rotation
    this.turned = false;
    this.stage.draw();
    this.coarser(passed);
  }

  // Without a graphics card fewer pixels are drawn, so that the body keeps moving.
  coarser(passed) {
    const { renderer } = this.stage,
      ratio = renderer.getPixelRatio();
    this.slow = passed > SLOW ? this.slow + 1 : 0;
    if (this.slow < 10 || ratio <= COARSEST) return;
    this.slow = 0;
    renderer.setPixelRatio(Math.max(COARSEST, ratio / 1.5));
  }
}
