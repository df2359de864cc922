// The stage of every page: ground, light, camera. Who stands on it is the page's own.
import {
  AmbientLight, CanvasTexture, Color, DirectionalLight, Fog, HemisphereLight, Mesh, MeshBasicMaterial,
  PCFShadowMap, PerspectiveCamera, PlaneGeometry, RepeatWrapping, SRGBColorSpace, Scene, ShadowMaterial, Vector3,
  WebGLRenderer,
} from 'three';
import {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';

const LIGHT = {sky: '#f1f4f9', ground: '#e9edf3', fine: '#d6dce6', line: '#c5cdda', shade: 0.22, glow: 1};
const DARK = {sky: '#14171d', ground: '#1b1f27', fine: '#222832', line: '#303844', shade: 0.5, glow: 0.72};

// A square metre of ground with its lines; mipmaps keep them smooth far away.
function tile(renderer, look) {
  const size = 512, canvas = Object.assign(document.createElement('canvas'), {width: size, height: size});
  const pen = canvas.getContext('2d');
  pen.fillStyle = look.ground;
  pen.fillRect(0, 0, size, size);
  for (const [at, width, color] of [[size / 2, 3, look.fine], [0, 8, look.line], [size, 8, look.line]]) {
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

export class Stage {
  // preserve: whether the picture can be read back after it was drawn.
  constructor(element, {dark = false, preserve = true} = {}) {
    this.element = element;
    this.renderer = new WebGLRenderer({antialias: true, preserveDrawingBuffer: preserve});
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    element.appendChild(this.renderer.domElement);

    this.scene = new Scene();
    this.camera = new PerspectiveCamera(32, 1, 0.1, 300);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.enableDamping = true;
    this.controls.maxPolarAngle = Math.PI * 0.495;

    this.ground = new Mesh(new PlaneGeometry(400, 400), new MeshBasicMaterial());
    this.shade = new Mesh(new PlaneGeometry(400, 400), new ShadowMaterial({color: 0x1c2333}));
    for (const plane of [this.ground, this.shade]) plane.rotation.x = -Math.PI / 2;
    this.ground.material.polygonOffset = true;
    this.ground.material.polygonOffsetFactor = this.ground.material.polygonOffsetUnits = 2;
    this.shade.position.y = 0.002;
    this.shade.receiveShadow = true;
    this.lamps = [new HemisphereLight(0xffffff, 0xcdd3df, 1.7), new AmbientLight(0xffffff, 0.35)];
    this.sun = new DirectionalLight(0xffffff, 2.0);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    this.sun.shadow.radius = 5;
    this.sun.shadow.bias = -0.0006;
    this.sun.shadow.normalBias = 0.012;
    this.scene.add(this.ground, this.shade, ...this.lamps, this.sun, this.sun.target);
    this.above = new Vector3();
    this.far = [15, 30];
    this.theme(dark);
  }

  theme(dark) {
    const look = dark ? DARK : LIGHT;
    this.sky = new Color(look.sky);
    this.scene.background = this.sky;
    this.ground.material.map?.dispose();
    this.ground.material.map = tile(this.renderer, look);
    this.ground.material.needsUpdate = true;
    this.shade.material.opacity = look.shade;
    this.lamps[0].intensity = 1.7 * look.glow;
    this.sun.intensity = 2.0 * look.glow;
    this.fog(...this.far);
  }

  // Where the ground begins and ends to fade, metres from the camera.
  fog(near, far) {
    this.far = [near, far];
    this.scene.fog = new Fog(this.sky, near, far);
  }

  // Shadows as far as a scene of this width needs them.
  light(width) {
    const reach = Math.min(Math.max(width * 0.75, 2.6), 25);
    Object.assign(this.sun.shadow.camera, {left: -reach, right: reach, top: reach, bottom: -reach, near: 0.5, far: 60});
    this.sun.shadow.camera.updateProjectionMatrix();
  }

  resize() {
    const {clientWidth, clientHeight} = this.element;
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / Math.max(clientHeight, 1);
    this.camera.updateProjectionMatrix();
  }

  // Moves the camera and what it looks at.
  carry(dx, dz) {
    this.controls.target.x += dx;
    this.controls.target.z += dz;
    this.camera.position.x += dx;
    this.camera.position.z += dz;
  }

  draw() {
    this.sun.target.position.set(this.controls.target.x, 0.8, this.controls.target.z);
    this.sun.position.copy(this.sun.target.position).add(this.above.set(4, 9, 5));
    // The ground follows by whole metres, the period of its lines: it has no end, and the lines stay where they are.
    for (const plane of [this.ground, this.shade]) {
      plane.position.x = Math.round(this.controls.target.x);
      plane.position.z = Math.round(this.controls.target.z);
    }
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }
}
