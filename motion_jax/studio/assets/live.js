// One live motion: the socket, the frames that have come, the clock that plays them.
import { asJson } from "./control.js";
import { open } from "./stream.js";

const KEPT = 12_000; // frames: ten minutes
const DROPPED = 1200; // that go at once when there are more
const GONE = "the studio has gone; trying to reach it again";
const AGAIN = 1000; // milliseconds until the page tries to reach the studio again

export class Live {
  // tell(sentence, isError): for the user; forget(sentence): it is true no longer; changed(): something that is shown
  // has changed; check(): asks the studio whether it would let this page in; anew(): a motion has begun in the place of
  // one that was led along a path.
  constructor(token, { tell, forget, changed, check, anew }) {
    Object.assign(this, { token, tell, forget, changed, check, anew });
    this.state = "connecting";
    this.choices = { prompt: "a person walks forward", speed: 1, keep_going: true };
    this.asked = null; // other choices, until the studio has begun with them
    this.reconnects = this.missed = 0;
    this.progress = null;
    this.connected = this.closed = false;
    this.clear();
  }

  // A motion begins: nothing of an older one is left.
  clear() {
    Object.assign(this, {
      run: 0,
      fps: 20,
      count: 22,
      parents: [],
      blockFrames: 12,
      joints: new Float32Array(0),
      stands: new Uint8Array(0),
      first: 0,
      frames: 0,
      time: 0,
      played: 0,
      committed: 0,
      begun: 0,
      waitingBlocks: [],
      words: [],
      sampling: 0,
      latency: null,
      said: null,
      starved: false,
      held: null,
      blocks: 0,
    });
  }

  connect() {
    this.stream = open(this.token, {
      opened: () => this.opened(),
      closed: () => this.lost(),
      message: (message) => this.message(message),
      block: (block) => this.block(block),
    });
  }

  opened() {
    this.connected = true;
    this.asked = null;
    this.forget(GONE);
    if (this.reconnects) this.tell("the studio is there again; the motion begins anew", false);
    this.send({ type: "start", ...this.choices });
    this.changed();
  }

  lost() {
    if (this.connected) this.tell(GONE, true);
    else this.check();
    if (this.connected) this.reconnects += 1;
    this.connected = false;
    this.state = "lost";
    this.progress = null;
    this.changed();
    setTimeout(() => this.connect(), AGAIN);
  }

  send(message) {
    this.stream?.send(message);
  }

  message(message) {
    if (message.type === "started") {
      const led = this.held?.until > 0;
      this.clear();
      if (message.sequence) this.send({ type: "ack", sequence: message.sequence - 1 }); // an older run is played no more
      this.run = message.run;
      this.fps = message.fps;
      this.blockFrames = message.block_frames;
      this.parents = message.parents;
      this.count = message.joints.length;
      this.choices = { ...this.choices, ...this.asked, seed: message.seed };
      this.asked = null;
      this.model = { name: message.model, id: message.id };
      this.progress = null;
      if (led) this.anew();
    } else if (message.type === "words") {
      this.words = this.words.filter((one) => one.from < message.from_frame);
      this.choices.prompt = message.whole;
      this.words.push({ words: message.words, prompt: message.prompt, from: message.from_frame });
      if (message.unknown.length) {
        const nearest = message.nearest ? `; what it knows and comes nearest is “${message.nearest}”` : "";
        this.tell(`the model has not learned: ${message.unknown.join(", ")}${nearest}`, false);
      }
    } else if (message.type === "state") {
      this.state = message.state;
      this.progress = message.doing ? message : null;
    } else if (message.type === "held") {
      this.held = { from: message.from_frame, until: message.until_frame };
    } else if (message.type === "error") {
      this.said = this.asked = null;
      this.tell(message.message, true);
    }
    this.changed();
  }

  block(block) {
    if (block.run !== this.run) return;
    this.room(this.frames + block.frames);
    this.joints.set(block.positions, 3 * this.count * this.frames);
    this.stands.set(block.contacts, 4 * this.frames);
    this.frames += block.frames;
    this.committed = block.committed;
    this.begun = block.begun;
    this.sampling = block.milliseconds;
    this.blocks += 1;
    this.waitingBlocks.push({ sequence: block.sequence, past: block.firstFrame + block.frames });
    this.changed();
  }

  // Makes the arrays long enough for so many frames; the oldest go where there are too many.
  room(frames) {
    if (frames > KEPT) {
      this.joints.copyWithin(0, 3 * this.count * DROPPED, 3 * this.count * this.frames);
      this.stands.copyWithin(0, 4 * DROPPED, 4 * this.frames);
      this.first += DROPPED;
      this.frames -= DROPPED;
    } else if (3 * this.count * frames > this.joints.length) {
      const length = Math.min(KEPT, Math.max(512, 2 * frames)),
        { joints, stands } = this;
      this.joints = new Float32Array(3 * this.count * length);
      this.stands = new Uint8Array(4 * length);
      this.joints.set(joints);
      this.stands.set(stands);
    }
  }

  get end() {
    return this.first + this.frames;
  }

  get lead() {
    return Math.max(0, this.end - 1 - this.time * this.fps) / this.fps;
  }

  /** The words of a frame: {words, prompt, from}. */
  at(frame) {
    return this.words.findLast((one) => one.from <= frame) ?? null;
  }

  // The clock: so many seconds have passed.
  tick(passed) {
    if (this.state !== "running" && this.state !== "waiting" && this.state !== "ended") return;
    if (!this.frames) return;
    const last = (this.end - 1) / this.fps;
    if (this.time < this.played) this.time = this.played; // who looked back goes on from where it stopped
    const next = this.time + passed * this.choices.speed;
    const starved = next > last && this.state === "running";
    if (starved && !this.starved) this.missed += 1;
    this.starved = starved;
    this.time = this.played = Math.min(next, last);
    const frame = this.time * this.fps;
    while (this.waitingBlocks.length && this.waitingBlocks[0].past <= frame + 1.01) {
      this.send({ type: "ack", sequence: this.waitingBlocks.shift().sequence });
    }
    if (this.said && this.at(frame)?.words > this.said.after) {
      this.latency = (performance.now() - this.said.at) / 1000;
      this.said = null;
    }
  }

  /** Looks at another frame that has been played; while the motion runs there is nothing to look back at. */
  seek(time) {
    if (this.state === "running") this.pause();
    this.time = Math.max(this.first / this.fps, Math.min(time, this.played));
    this.changed();
  }

  say(prompt) {
    this.said = { at: performance.now(), after: this.words.at(-1)?.words ?? 0 };
    this.send({ type: "prompt", prompt });
  }

  /** The body goes along a path, a constraint, from where it is and from now on; without one it is free again. */
  follow(path) {
    const { times: _, ...kept } = path ?? {}; // of a story
    this.send({ type: "control", control: asJson(path ? [kept] : []) });
  }

  pause() {
    this.send({ type: "pause" });
    this.state = "paused";
    this.changed();
  }

  resume() {
    this.send({ type: "resume" });
  }

  /** Begins anew with other choices: {model, seed, sampling}; where the studio refuses them, nothing changes. */
  begin(choices) {
    this.asked = choices;
    this.send({ type: "start", ...this.choices, ...choices });
  }

  restart() {
    this.send({ type: "restart", prompt: this.choices.prompt });
  }

  speed(value) {
    this.choices.speed = value;
    this.send({ type: "speed", value });
  }

  keepGoing(on) {
    this.choices.keep_going = on;
    this.send({ type: "keep_going", on });
  }

  /** What has come, as a motion. */
  motion() {
    const captions = this.words
      .filter((one) => one.from < this.end)
      .map((one, i, all) => ({
        text: one.prompt,
        start: Math.max(0, one.from - this.first) / this.fps,
        end: ((all[i + 1]?.from ?? this.end) - this.first) / this.fps,
      }))
      .filter((caption) => caption.end > caption.start);
    return {
      fps: this.fps,
      frames: this.frames,
      count: this.count,
      captions,
      id: "live",
      skeleton: "humanml3d",
      joints: this.joints.slice(0, 3 * this.count * this.frames),
      meta: {},
    };
  }
}
