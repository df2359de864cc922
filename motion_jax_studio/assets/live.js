// One live motion: its socket, the received frames, and the clock that plays them.
import { asJson } from "./control.js";
import { open } from "./stream.js";
import { GONE, remarkOf } from "./messages.js";

const KEPT = 12_000; // frames: ten minutes
const DROPPED = 1200; // removed at once when there are more
const LOST = {
  gone: GONE,
  blocked: "a proxy before the studio passes no WebSockets, which the live motion needs; the timeline works",
  refused: "this address is out of date: open the one that the studio printed; your work is kept in this browser",
};
const AGAIN = 1000, // milliseconds until the first attempt to reconnect, then longer each time,
  LONGEST = 5000; // up to this
const RECENT = 10_000; // milliseconds after an interruption in which the stream counts as slow

export class Live {
  // address: of the stream. tell(sentence, isError, topic) and forget(topic): notes; changed(): the page has to be drawn again; reach(): whether the
  // studio is "there", "gone" or has "refused" this page's token; started(): a motion was requested; back(): the studio is
  // connected again; atStart(): a motion begins at its first frame; replaced(): a new motion replaces one that followed a path.
  constructor(address, { tell, forget, changed, reach, started, back, atStart = () => {}, replaced }) {
    Object.assign(this, { address, tell, forget, changed, reach, started, back, atStart, replaced });
    this.state = "connecting";
    this.choices = { prompt: "a person walks forward", speed: 1, keep_going: true };
    this.pendingChoices = null; // other choices, until the studio has started with them
    this.reconnects = this.missed = 0;
    this.progress = null;
    this.connected = this.restored = false;
    this.absence = null; // "gone", "refused" or "blocked": requests arrive and sockets do not
    this.wait = AGAIN;
    this.clear();
  }

  // Resets everything that belongs to one motion.
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
      pendingPrompt: null,
      starved: false,
      lastMissed: -Infinity,
      constrained: null,
      blocks: 0,
    });
  }

  // Checks with an ordinary request first: a refused socket would be an error in the studio's log.
  async connect() {
    const answer = await this.reach();
    if (answer !== "there") return this.missing(answer);
    this.stream = open(this.address, {
      opened: () => this.opened(),
      closed: () => this.lost(),
      message: (message) => this.message(message),
      block: (block) => this.block(block),
    });
  }

  missing(answer) {
    this.state = "lost";
    if (this.absence !== answer) this.tell(LOST[answer], true, "connection");
    this.absence = answer;
    this.changed();
    setTimeout(() => this.connect(), this.wait);
    this.wait = Math.min(LONGEST, this.wait * 1.5);
  }

  opened() {
    this.connected = true;
    this.pendingChoices = null;
    this.wait = AGAIN;
    this.absence = null;
    this.forget("connection");
    if (this.reconnects) this.tell("the studio is back; the live motion starts again, your project is unchanged", false);
    this.send({ type: "start", ...this.choices });
    this.started();
    if (this.reconnects) this.back();
    this.changed();
  }

  lost() {
    const wasOpen = this.connected;
    if (this.connected) this.reconnects += 1;
    this.connected = false;
    this.progress = null;
    this.missing(wasOpen ? "gone" : "blocked");
  }

  send(message) {
    this.stream?.send(message);
  }

  message(message) {
    if (message.type === "started") {
      const wasConstrained = this.constrained?.until > 0;
      this.clear();
      if (message.sequence) this.send({ type: "ack", sequence: message.sequence - 1 }); // an older run is no longer played
      this.run = message.run;
      this.fps = message.fps;
      this.blockFrames = message.block_frames;
      this.parents = message.parents;
      this.count = message.joints.length;
      this.choices = { ...this.choices, ...this.pendingChoices, seed: message.seed };
      this.pendingChoices = null;
      this.model = { name: message.model, id: message.id };
      this.restored = false;
      this.forget("stream");
      this.atStart();
      this.progress = null;
      if (wasConstrained) this.replaced();
    } else if (message.type === "words") {
      this.words = this.words.filter((one) => one.from < message.from_frame);
      this.choices.prompt = message.whole ?? message.prompt;
      const remark = remarkOf(message);
      this.words.push({ words: message.words, prompt: message.prompt, from: message.from_frame, remark });
      if (remark) this.remarked(message.words);
      else this.forget("words");
    } else if (message.type === "state") {
      this.state = message.state;
      this.progress = message.doing ? message : null;
    } else if (message.type === "constrained") {
      this.constrained = { from: message.from_frame, until: message.until_frame };
    } else if (message.type === "error") {
      this.pendingPrompt = this.pendingChoices = null;
      if (this.restored && !this.run) return this.forgetChoices();
      this.tell(message.message, true, "stream");
    }
    this.changed();
  }

  // Choices from before a reload are not available any more, such as a model that this studio does not have.
  forgetChoices() {
    const { prompt, speed, keep_going } = this.choices;
    this.restored = false;
    this.choices = { prompt, speed, keep_going };
    this.send({ type: "start", ...this.choices });
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

  // Makes room for this many frames; removes the oldest if there are too many.
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

  get recentlyMissed() {
    return performance.now() - this.lastMissed < RECENT;
  }

  /** The prompt of a frame: {words, prompt, from}. */
  at(frame) {
    return this.words.findLast((one) => one.from <= frame) ?? null;
  }

  // Advances the clock by this many seconds.
  tick(passed) {
    if (this.state !== "running" && this.state !== "waiting" && this.state !== "ended") return;
    if (!this.frames) return;
    const last = (this.end - 1) / this.fps;
    if (this.time < this.played) this.time = this.played; // after looking back, continue from where it stopped
    const next = this.time + passed * this.choices.speed;
    const starved = next > last && this.state === "running";
    if (starved && !this.starved) {
      this.missed += 1;
      this.lastMissed = performance.now();
    }
    this.starved = starved;
    this.time = this.played = Math.min(next, last);
    const frame = this.time * this.fps;
    while (this.waitingBlocks.length && this.waitingBlocks[0].past <= frame + 1.01) {
      this.send({ type: "ack", sequence: this.waitingBlocks.shift().sequence });
    }
    if (this.pendingPrompt && this.at(frame)?.words > this.pendingPrompt.after) {
      this.latency = (performance.now() - this.pendingPrompt.at) / 1000;
      this.pendingPrompt = null;
    }
  }

  /** Shows a frame that has been played; pauses a running motion. */
  seek(time) {
    if (this.state === "running") this.pause();
    this.time = Math.max(this.first / this.fps, Math.min(time, this.played));
    this.changed();
  }

  /** Shows the note of a prompt by its number, with the caption to use instead. */
  remarked(words) {
    const { short, nearest } = this.words.find((one) => one.words === words).remark;
    this.tell(short, false, "words", nearest ? { text: `Use “${nearest}”`, does: () => this.say(nearest) } : null);
  }

  say(prompt) {
    this.pendingPrompt = { at: performance.now(), after: this.words.at(-1)?.words ?? 0 };
    this.send({ type: "prompt", prompt });
  }

  /** The body follows a path, a constraint, from where it is; without one it is free again. */
  follow(path) {
    const { times: _, ...kept } = path ?? {}; // times belong to the timeline
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

  /** Starts again with other choices {model, seed, sampling}; nothing changes if the studio refuses them. */
  begin(choices) {
    this.pendingChoices = choices;
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

  /** The received frames as a motion. */
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
