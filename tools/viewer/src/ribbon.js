import {BufferGeometry, DoubleSide, Float32BufferAttribute, Mesh, MeshBasicMaterial, Vector3} from 'three';

// A way on the ground, [[x, z], ...] in metres, as a ribbon.
export function ribbon(roots, floor = 0, {color = 0xf2853f, width = 0.026, opacity = 0.75} = {}) {
  const vertices = [], index = [], last = new Vector3(Infinity, 0, 0), here = new Vector3();
  for (const [x, z] of roots) {
    here.set(x, 0, z);
    if (here.distanceTo(last) < 0.02) continue;
    if (Number.isFinite(last.x)) {
      const ahead = here.clone().sub(last).normalize();
      const side = new Vector3(ahead.z, 0, -ahead.x).multiplyScalar(width / 2);
      for (const point of vertices.length ? [here] : [last, here]) {
        for (const sign of [1, -1]) vertices.push(point.x + sign * side.x, floor + 0.004, point.z + sign * side.z);
        const n = vertices.length / 3;
        if (n >= 4) index.push(n - 4, n - 3, n - 2, n - 3, n - 1, n - 2);
      }
    }
    last.copy(here);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new Float32BufferAttribute(vertices, 3));
  geometry.setIndex(index);
  const look = {color, transparent: true, opacity, side: DoubleSide};
  const way = new Mesh(geometry, new MeshBasicMaterial(look));
  way.frustumCulled = false;
  return way;
}
