// The page: a stage with figures, a bar to play them, a caption. All data is in the element #motion.
import {
  AmbientLight, Box3, CanvasTexture, Color, DirectionalLight, Fog, HemisphereLight, Mesh, MeshBasicMaterial,
  PCFSoftShadowMap, PerspectiveCamera, PlaneGeometry, RepeatWrapping, SRGBColorSpace, Scene, ShadowMaterial, Vector3,
  WebGLRenderer,
} from 'three';
import {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';
import {Body} from './body.js';

const $ = (id) => document.getElementById(id);
const data = JSON.parse($('motion').textContent), clips = data.clips;
const state = {time: 0, playing: true, speed: 1, follow: true, only: -1, last: 0};
const seconds = Math.max(...clips.map((clip) => (clip.frames - 1) / clip.fps));

// A square metre of ground with its lines; mipmaps keep them smooth far away.
function tile(renderer) {
  const size = 512, canvas = Object.assign(document.createElement('canvas'), {width: size, height: size});
  const pen = canvas.getContext('2d');
  pen.fillStyle = '#e9edf3';
  pen.fillRect(0, 0, size, size);
  for (const [at, width, color] of [[size / 2, 3, '#d6dce6'], [0, 8, '#c5cdda'], [size, 8, '#c5cdda']]) {
    pen.fillStyle = color;
    pen.fillRect(at - width / 2, 0, width, size);
    pen.fillRect(0, at - width / 2, size, width);
  }
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.repeat.set(400, 400);
  texture.anisotropy = renderer.capabilities.getMaxAnisotropy();
  return texture;
}

function start() {
  const sky = new Color(0xf1f4f9);
  const renderer = new WebGLRenderer({antialias: true, preserveDrawingBuffer: true});
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = PCFSoftShadowMap;
  $('stage').appendChild(renderer.domElement);

  const scene = new Scene();
  scene.background = sky;
  const camera = new PerspectiveCamera(32, 1, 0.1, 300);
  const controls = new OrbitControls(camera, renderer.domElement);
  controls.enableDamping = true;
  controls.maxPolarAngle = Math.PI * 0.495;

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

  const ground = new Mesh(new PlaneGeometry(400, 400), new MeshBasicMaterial({map: tile(renderer)}));
  const shade = new Mesh(new PlaneGeometry(400, 400), new ShadowMaterial({opacity: 0.22, color: 0x1c2333}));
  for (const plane of [ground, shade]) plane.rotation.x = -Math.PI / 2;
  ground.material.polygonOffset = true;
  ground.material.polygonOffsetFactor = ground.material.polygonOffsetUnits = 2;
  shade.position.y = 0.002;
  shade.receiveShadow = true;
  scene.add(ground, shade);

  scene.add(new HemisphereLight(0xffffff, 0xcdd3df, 1.7), new AmbientLight(0xffffff, 0.35));
  const sun = new DirectionalLight(0xffffff, 2.0);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  sun.shadow.radius = 5;
  sun.shadow.bias = -0.0006;
  sun.shadow.normalBias = 0.012;
  scene.add(sun, sun.target);

  const shown = () => bodies.filter((_, i) => state.only < 0 || state.only === i);
  const centre = new Vector3(), one = new Vector3(), target = new Vector3();
  function where() {
    centre.set(0, 0, 0);
    for (const body of shown()) centre.add(body.root(one));
    centre.divideScalar(shown().length);
    return centre;
  }

  function light(width) {
    const reach = Math.min(Math.max(width * 0.75, 2.6), 25);
    Object.assign(sun.shadow.camera, {left: -reach, right: reach, top: reach, bottom: -reach, near: 0.5, far: 60});
    sun.shadow.camera.updateProjectionMatrix();
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
    scene.fog = new Fog(sky, distance + 4, distance + 19);
    light(width);
    controls.update();
  }

  function resize() {
    const stage = $('stage');
    renderer.setSize(stage.clientWidth, stage.clientHeight);
    camera.aspect = stage.clientWidth / Math.max(stage.clientHeight, 1);
    camera.updateProjectionMatrix();
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

  function draw() {
    bodies.forEach((body, i) => body.show(state.time * clips[i].fps));
    if (state.follow) {
      where();
      const easing = Math.min(1, state.delta * 5), dz = (centre.z - controls.target.z) * easing;
      const dx = shown().length === 1 ? (centre.x - controls.target.x) * easing : 0;
      controls.target.x += dx;
      controls.target.z += dz;
      camera.position.x += dx;
      camera.position.z += dz;
    }
    sun.target.position.set(controls.target.x, 0.8, controls.target.z);
    sun.position.copy(sun.target.position).add(one.set(4, 9, 5));
    controls.update();
    renderer.render(scene, camera);
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
  window.addEventListener('resize', () => { resize(); frame(); });

  // A page address that ends in #2.5 opens standing still at that second.
  const at = Number(location.hash.slice(1));
  resize();
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

try {
  window.motionViewer = start();
} catch (error) {
  document.body.dataset.state = 'failed';
  $('caption').textContent = `This page needs WebGL, which this browser does not offer (${error.message}).`;
}
