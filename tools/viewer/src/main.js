// The bundle: a page that has motions inside starts by itself; the studio builds its own from these parts.
import {
  BufferAttribute, BufferGeometry, CircleGeometry, Color, Group, InstancedMesh, LineBasicMaterial, LineSegments, Matrix4,
  Mesh, MeshBasicMaterial, Object3D, Quaternion, SphereGeometry, Vector3,
} from 'three';
import {TransformControls} from 'three/examples/jsm/controls/TransformControls.js';
import {Figure} from './body.js';
import {readCharacter} from './character.js';
import {Marks, PALE} from './marks.js';
import {start} from './page.js';
import {ribbon} from './ribbon.js';
import {Stage} from './scene.js';
import {Turns} from './turns.js';

window.motionParts = {
  Figure, Marks, PALE, Stage, TransformControls, Turns, readCharacter, ribbon,
  three: {
    BufferAttribute, BufferGeometry, CircleGeometry, Color, Group, InstancedMesh, LineBasicMaterial, LineSegments, Matrix4,
    Mesh, MeshBasicMaterial, Object3D, Quaternion, SphereGeometry, Vector3,
  },
};

if (document.getElementById('motion')) {
  try {
    window.motionViewer = start();
  } catch (error) {
    document.body.dataset.state = 'failed';
    document.getElementById('caption').textContent =
      `This page needs WebGL, which this browser does not offer (${error.message}).`;
  }
}
