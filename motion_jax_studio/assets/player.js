// The clock of a complete motion. Needs no browser.

export class Player {
  constructor() {
    Object.assign(this, { time: 0, playing: false, repeat: false, frames: 0, fps: 20 });
  }

  /** Loads another motion; the play head stays where it is, if possible. */
  load(motion) {
    this.frames = motion?.frames ?? 0;
    this.fps = motion?.fps ?? 20;
    this.seek(this.time);
  }

  get last() {
    return Math.max(0, this.frames - 1) / this.fps;
  }

  get frame() {
    return Math.round(this.time * this.fps);
  }

  seek(time) {
    this.time = Math.max(0, Math.min(Number.isFinite(time) ? time : 0, this.last));
  }

  /** Steps by whole frames, and pauses. */
  step(frames) {
    this.playing = false;
    this.seek((this.frame + frames) / this.fps);
  }

  /** Plays or pauses; restarts at the end. */
  toggle() {
    if (!this.playing && this.time >= this.last) this.time = 0;
    this.playing = !this.playing && this.frames > 1;
  }

  tick(passed) {
    if (!this.playing) return;
    this.time += passed;
    if (this.time < this.last) return;
    if (this.repeat && this.last > 0) this.time %= this.last;
    else {
      this.time = this.last;
      this.playing = false;
    }
  }
}
