// Reads a dropped .glb or .vrm with three.js, after checks whose failure is one sentence for the user.
import {MeshoptDecoder} from 'three/examples/jsm/libs/meshopt_decoder.module.js';
import {GLTFLoader} from 'three/examples/jsm/loaders/GLTFLoader.js';

const MAGIC = 0x46546c67, JSON_CHUNK = 0x4e4f534a, MOST = 300e6;  // bytes
// What the loader reads without the decoders that this page leaves out.
const UNREAD = {KHR_draco_mesh_compression: 'Draco', KHR_texture_basisu: 'Basis textures'};

/** The JSON of a .glb; name: for the sentence of an Error where it is none. */
export function readJson(bytes, name) {
  const view = new DataView(bytes);
  if (bytes.byteLength > MOST) throw new Error(`${name} has ${Math.round(bytes.byteLength / 1e6)} MB, expected at most ${MOST / 1e6} MB; reduce its textures`);
  if (bytes.byteLength < 20 || view.getUint32(0, true) !== MAGIC) throw new Error(`${name} is no binary glTF file; export the character as .glb or .vrm`);
  if (view.getUint32(4, true) !== 2) throw new Error(`${name} is glTF ${view.getUint32(4, true)}, expected version 2; export it again`);
  if (view.getUint32(8, true) > bytes.byteLength) throw new Error(`${name} is cut off: it has ${bytes.byteLength} of ${view.getUint32(8, true)} bytes; copy it again`);
  const length = view.getUint32(12, true);
  if (view.getUint32(16, true) !== JSON_CHUNK || 20 + length > bytes.byteLength) throw new Error(`${name} begins with no JSON, as a .glb does; export it again`);
  let json;
  try {
    json = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 20, length)));
  } catch {
    throw new Error(`${name} holds JSON that is not valid; export it again`);
  }
  const packed = (json.extensionsRequired ?? []).find((extension) => UNREAD[extension]);
  if (packed) throw new Error(`${name} is compressed with ${UNREAD[packed]}, which this page does not read; export it without compression`);
  if ([...(json.buffers ?? []), ...(json.images ?? [])].some(({uri}) => uri && !uri.startsWith('data:'))) {
    throw new Error(`${name} refers to other files; export it as one .glb with everything inside`);
  }
  if (!json.skins?.length) throw new Error(`${name} has no skin, the mesh is not bound to bones; export it with its armature`);
  return json;
}

/** {json, scene, nodes}: nodes[i] is the object of the file's node i. */
export async function readGlb(bytes, name) {
  const json = readJson(bytes, name);
  let gltf;
  try {
    gltf = await new GLTFLoader().setMeshoptDecoder(MeshoptDecoder).parseAsync(bytes, '');
  } catch (error) {
    throw new Error(`${name} cannot be read (${String(error.message ?? error).split('\n')[0]}); export it again`);
  }
  const nodes = [];
  gltf.scene.traverse((object) => {
    const index = gltf.parser.associations.get(object)?.nodes;
    if (index !== undefined && !nodes[index]) nodes[index] = object;
  });
  return {json, scene: gltf.scene, nodes};
}
