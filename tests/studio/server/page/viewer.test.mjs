// Parts of the viewer that draw nothing, beside what Python says (expected.json): run by test_page_parts.py.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";
import { runInThisContext } from "node:vm";

Object.assign(globalThis, { window: globalThis, document: { getElementById: () => null } });
runInThisContext(readFileSync("viewer.js", "utf8"));
const { Turns, readCharacter, three } = window.motionParts;
const { body, clip, turned, motion, characters, refused } = JSON.parse(readFileSync("expected.json", "utf8"));
const turns = new Turns(body.names, body.parents, body.rest);
const read = (name, bytes) => readCharacter(Uint8Array.from(Buffer.from(bytes, "base64")).buffer, name, body.limbs);

function posed(frame) {
  const places = frame.map((place) => new three.Vector3(...place)),
    rotations = frame.map(() => new three.Quaternion());
  turns.set(places, rotations);
  return { places, rotations };
}

test("limbs are turned as exports turn them: a few degrees apart, as exports smooth over time", () => {
  const off = body.names.map(() => []);
  clip.forEach((frame, i) =>
    posed(frame).rotations.forEach(({ w, x, y, z }, j) => {
      const cosine = [w, x, y, z].reduce((sum, value, k) => sum + value * turned[i][j][k], 0);
      off[j].push((360 / Math.PI) * Math.acos(Math.min(1, Math.abs(cosine))));
    }),
  );
  const median = (values) => values.sort((a, b) => a - b)[values.length >> 1];
  assert.ok(median(off.flat()) < 2 && Math.max(...off.map(median)) < 20, off.map(median).join(" "));
});

for (const [name, bytes] of Object.entries(characters)) {
  test(`the bones of ${name} stand where the joints of a motion do`, async () => {
    const figure = (await read(name, bytes)).figure(body);
    for (const frame of motion) {
      const { places, rotations } = posed(frame);
      figure.put(places, rotations);
      const bones = figure.places();
      assert.ok(["pelvis", "left_ankle", "right_wrist"].every((joint) => bones[joint]));
      for (const [joint, place] of Object.entries(bones)) {
        const off = new three.Vector3(...place).distanceTo(places[body.names.indexOf(joint)]);
        assert.ok(off < 0.01, `${joint}: ${off} m`);
      }
    }
  });
}

test("a character is drawn as tall as the mannequin, whatever its unit and its legs", async () => {
  const { places, rotations } = posed(body.rest),
    size = async (name) => {
      const figure = (await read(name, characters[name])).figure(body);
      figure.put(places, rotations);
      return { size: figure.size, tall: figure.size * figure.retarget.scale * figure.character.height };
    };
  const found = Object.fromEntries(await Promise.all(Object.keys(characters).map(async (name) => [name, await size(name)])));
  const { tall } = found["mixamo.glb"];
  assert.ok(tall > 1.6 && tall < 1.9, `${tall} m`);
  for (const [name, { tall: other }] of Object.entries(found)) assert.ok(Math.abs(other - tall) < 1e-6, `${name}: ${other} m`);
});

test("a file that is no character gets one sentence with its name", async () => {
  for (const [name, [bytes, words]] of Object.entries(refused))
    await assert.rejects(read(name, bytes), ({ message }) => message.startsWith(name) && message.includes(words), name);
});
