// A page with motions inside: figures on a stage, a bar to play them, a caption. All data is in the element #motion.
import {Box3, Vector3} from 'three';
import {Body} from './body.js';
import {Stage} from './scene.js';

const $ = (id) => document.getElementById(id);
const state = {time: 0, playing: true, speed: 1, follow: true, only: -1, last: 0};

export function start() {
  const data = JSON.parse($('motion').textContent), clips = data.clips;
  const seconds = Math.max(...clips.map((clip) => (clip.frames - 1) / clip.fps));
  const dark = matchMedia('(prefers-color-scheme: dark)');
  const stage = new Stage($('stage'), {dark: dark.matches});
  dark.onchange = () => stage.theme(dark.matches);
  const {renderer, scene, camera, controls} = stage;

  // Side by side: each figure gets as much room across as its motion takes.
  let edge = 0;
  const widths = clips.map((clip) => Math.max(1.5, clip.high[0] - clip.low[0] + 0.7));
  const total = widths.reduce((sum, width) => sum + width, 0);
  const bodies = clips.map((clip, i) => {
    // The start sits in its lane so that the whole motion stays inside.
    const middle = (clip.low[0] + clip.high[0]) / 2 - clip.start[0];
    const x = clips.length > 1 ? edge + widths[i] / 2 - total / 2 - middle : 0;
    edge += widths[i];
    const body = new Body(clip, data.bodies[clip.body], data.colors, new Vector3(x, 0, 0));
    scene.add(body.group);
    return body;
  });

  const box = new Box3();
  clips.forEach((clip, i) => {
    const shift = bodies[i].group.position;
    box.expandByPoint(new Vector3(clip.low[0], clip.low[1], clip.low[2]).add(shift));
    box.expandByPoint(new Vector3(clip.high[0], clip.high[1], clip.high[2]).add(shift));
  });
  const middle = box.getCenter(new Vector3()), size = box.getSize(new Vector3());

  const shown = () => bodies.filter((_, i) => state.only < 0 || state.only === i);
  const centre = new Vector3(), one = new Vector3(), target = new Vector3();
  function where() {
    centre.set(0, 0, 0);
    for (const body of shown()) centre.add(body.root(one));
    centre.divideScalar(shown().length);
    return centre;
  }

  function frame() {
    const visible = shown();
    bodies.forEach((body) => { body.group.visible = visible.includes(body); });
    const single = visible.length === 1;
    const clip = clips[bodies.indexOf(visible[0])];
    const width = single ? (state.follow ? 1.6 : Math.max(clip.high[0] - clip.low[0], clip.high[2] - clip.low[2]) + 1) : size.x + 0.4;
    const aspect = camera.aspect, tall = single ? 2.75 : 2.9, half = Math.tan((camera.fov * Math.PI) / 360);
    const distance = Math.max(tall / 2 / half, width / 2 / half / aspect) * 1.02
      + (single && state.follow ? 0.3 : Math.min(size.z / 2, single ? 9 : 1.6));
    where();
    target.set(state.follow && single ? centre.x : middle.x, single ? 0.95 : 0.75, state.follow ? centre.z : middle.z);
    const front = single ? Math.atan2(clip.ahead[0], clip.ahead[1]) + 0.6 : 0.18;
    controls.target.copy(target);
    camera.position.set(target.x + Math.sin(front) * distance * 0.97, target.y + distance * 0.21, target.z + Math.cos(front) * distance * 0.97);
    stage.fog(distance + 4, distance + 19);
    stage.light(width);
    controls.update();
  }

  const tags = clips.length > 1 ? clips.map((clip, i) => {
    const tag = document.createElement('div');
    tag.className = 'tag';
    tag.textContent = String(i + 1);
    $('tags').appendChild(tag);
    return tag;
  }) : [];

  function caption() {
    const now = state.only < 0 ? clips : [clips[state.only]];
    let texts = now.map((clip) => {
      const spans = clip.captions.filter((c) => (!c.start && !c.end) || (c.start <= state.time && state.time < c.end));
      return (spans[0] || clip.captions[0] || {text: ''}).text;
    });
    if (new Set(texts).size === 1) texts = texts.slice(0, 1);
    const text = texts.length === 1 ? texts[0] : texts.map((one, i) => `${i + 1}. ${one}`).join('\n');
    if ($('caption').textContent !== text) $('caption').textContent = text;
  }

  const off = clips.some((clip) => clip.constraints) ? constraintsRow(bodies) : null;
  // How far the motions that are seen are from their constraints.
  function distance() {
    const found = shown().map((body) => body.clip).filter((clip) => clip.constraints?.off);
    if (!found.length) return '';
    const worst = found.reduce((a, b) => (b.constraints.off.worst > a.constraints.off.worst ? b : a)), {constraints} = worst;
    const mean = found.reduce((sum, clip) => sum + clip.constraints.off.mean, 0) / found.length, mm = (x) => x.toFixed(x < 10 ? 1 : 0);
    return `from the constraints: mean ${mm(mean)} mm, worst ${mm(constraints.off.worst)} mm (${constraints.off.joint} at ` +
      `${(constraints.off.frame / worst.fps).toFixed(2)} s${found.length > 1 ? `, motion ${clips.indexOf(worst) + 1}` : ''})`;
  }

  function draw() {
    bodies.forEach((body, i) => body.show(state.time * clips[i].fps));
    if (state.follow) {
      where();
      const easing = Math.min(1, state.delta * 5), dz = (centre.z - controls.target.z) * easing;
      const dx = shown().length === 1 ? (centre.x - controls.target.x) * easing : 0;
      stage.carry(dx, dz);
    }
    stage.draw();
    tags.forEach((tag, i) => {
      bodies[i].root(one);
      one.y = 1.95;
      one.project(camera);
      tag.style.display = bodies[i].group.visible && one.z < 1 ? '' : 'none';
      tag.style.left = `${(one.x + 1) * 50}%`;
      tag.style.top = `${(1 - one.y) * 50}%`;
    });
    $('time').textContent = `${state.time.toFixed(1)} / ${seconds.toFixed(1)} s`;
    if (document.activeElement !== $('seek') || state.playing) $('seek').value = String(seconds ? (state.time / seconds) * 1000 : 0);
    caption();
    if (off && off.textContent !== distance()) off.textContent = distance();
  }

  function play(on) {
    state.playing = on;
    $('play').textContent = on ? '❚❚' : '▶';
    $('play').setAttribute('aria-label', on ? 'Pause' : 'Play');
  }

  function seek(time) {
    state.time = Math.max(0, Math.min(time, seconds));
  }

  $('play').onclick = () => play(!state.playing);
  $('seek').oninput = () => { play(false); seek((Number($('seek').value) / 1000) * seconds); };
  $('speed').onchange = () => { state.speed = Number($('speed').value); };
  $('follow').onchange = () => { state.follow = $('follow').checked; frame(); };
  $('path').onchange = () => bodies.forEach((body) => { body.way.visible = $('path').checked; });
  $('reset').onclick = frame;
  if (clips.length > 1) {
    clips.forEach((clip, i) => $('which').add(new Option(`${i + 1}. ${clip.name}`, String(i))));
    $('which').onchange = () => { state.only = Number($('which').value); frame(); };
  } else {
    $('which').hidden = true;
  }
  window.addEventListener('keydown', (event) => {
    const step = 1 / clips[0].fps;
    const act = {' ': () => play(!state.playing), ArrowRight: () => { play(false); seek(state.time + step); },
      ArrowLeft: () => { play(false); seek(state.time - step); }}[event.key];
    if (act && event.target.tagName !== 'SELECT') { act(); event.preventDefault(); }
  });
  window.addEventListener('resize', () => { stage.resize(); frame(); });

  // A page address that ends in #2.5 opens standing still at that second.
  const at = Number(location.hash.slice(1));
  stage.resize();
  play(!(location.hash && Number.isFinite(at)));
  if (!state.playing) seek(at);
  bodies.forEach((body, i) => body.show(state.time * clips[i].fps));
  frame();
  const tick = (now) => {
    state.delta = Math.min((now - (state.last || now)) / 1000, 0.1);
    state.last = now;
    if (state.playing) {
      state.time += state.delta * state.speed;
      if (state.time > seconds) state.time = seconds > 0 ? state.time % seconds : 0;
    }
    draw();
    document.body.dataset.frame = String(Math.round(state.time * clips[0].fps));
    document.body.dataset.state = 'ready';
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
  return {state, scene, camera, controls, bodies, renderer};
}

// Adds to the bar: a switch that shows the constraints, and the distance of the motion from them.
function constraintsRow(bodies) {
  const label = document.createElement('label'), box = document.createElement('input'), told = document.createElement('span');
  Object.assign(box, {type: 'checkbox', checked: true, id: 'constraints'});
  box.onchange = () => bodies.forEach((body) => { if (body.marks) body.marks.group.visible = box.checked; });
  label.append(box, ' constraints');
  $('path').parentElement.after(label);
  Object.assign(told, {id: 'off', style: 'color: var(--soft); font-variant-numeric: tabular-nums'});
  $('bar').append(told);
  return told;
}
