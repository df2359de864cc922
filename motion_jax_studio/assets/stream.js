// A live stream of docs/protocol.md: its socket and the unpacking of blocks.

const HALF = (bits) => {
  const sign = bits & 0x8000 ? -1 : 1,
    exponent = (bits >> 10) & 31,
    rest = bits & 1023;
  return exponent ? sign * 2 ** (exponent - 15) * (1 + rest / 1024) : sign * 2 ** -24 * rest;
};

/** {sequence, run, firstFrame, frames, joints, words, committed, begun, milliseconds, fps, positions, contacts}
    positions: Float32Array of frames * joints * 3, metres; contacts: Uint8Array of frames * 4. */
export function unpack(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0) !== 0x4d4a5853) throw new Error("got data that is not a motion block");
  const header = view.getUint16(6, true),
    frames = view.getUint16(20, true),
    joints = view.getUint16(22, true);
  const ground = new Float32Array(buffer, header, frames * 2);
  const halves = new Uint16Array(buffer, header + frames * 8, frames * joints * 3);
  const positions = Float32Array.from(halves, HALF);
  for (let i = 0; i < frames * joints; i++) {
    const frame = Math.floor(i / joints);
    positions[3 * i] += ground[2 * frame];
    positions[3 * i + 2] += ground[2 * frame + 1];
  }
  return {
    sequence: view.getUint32(8, true),
    run: view.getUint32(12, true),
    firstFrame: view.getUint32(16, true),
    frames,
    joints,
    words: view.getUint32(24, true),
    committed: view.getUint32(28, true),
    begun: view.getUint32(32, true),
    milliseconds: view.getFloat32(36, true),
    fps: view.getFloat32(40, true),
    positions,
    contacts: new Uint8Array(buffer, header + frames * (8 + joints * 6), frames * 4),
  };
}

/** The address of a socket from the URL of the same place by http or https. */
export const socketAddress = ({ href }, token) => `${href.replace(/^http/, "ws")}?token=${encodeURIComponent(token)}`;

/** Opens the stream at an address; calls on.opened(), on.block(block), on.message(message) and on.closed(). */
export function open(address, on) {
  const socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  const send = (message) => socket.readyState === 1 && socket.send(JSON.stringify(message));
  socket.onmessage = ({ data }) => (typeof data === "string" ? on.message(JSON.parse(data)) : on.block(unpack(data)));
  socket.onclose = () => on.closed();
  socket.onopen = () => on.opened();
  return { send, close: () => socket.close() };
}
