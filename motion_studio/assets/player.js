// The clock of a motion that is there as a whole. No browser is needed here.

export class Player {
  constructor() {
    Object.assign(this, { time: 0, playing: false, repeat: false, frames: 0, fps: 20 });
  }

  /** Another motion; the play head stays where it is, if there is something. */
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

  /** Whole frames forth or back; it stands still then. */
  step(frames) {
    this.playing = false;
    this.seek((this.frame + frames) / this.fps);
  }

  /** At the end it begins again. */
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
