// Files of the page: fetched once, kept by the browser, unpacked here, so that any static host will do.
const NAME = 'motion-jax-try';

/** The bytes of a file. progress(bytes) is called as they come. An error says which file failed. */
export async function load(url, progress = () => {}) {
  const cache = await globalThis.caches?.open(NAME).catch(() => null);
  const version = new URL(url, location.href), path = url.replace(/\?.*/, '');
  let response = await cache?.match(version.href);
  if (!response) {
    try {
      response = await fetch(version);
    } catch {
      throw new Error(`the file ${path} did not arrive`);
    }
    if (!response.ok) throw new Error(`the file ${path} did not arrive (${response.status})`);
    const bytes = await read(response, progress);
    await cache?.put(version.href, new Response(bytes)).catch(() => {}); // a full disk is no reason to stop
    return unpack(bytes);
  }
  return unpack(await read(response, progress));
}

async function read(response, progress) {
  const parts = [], reader = response.body.getReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    parts.push(part.value);
    progress(part.value.length);
  }
  return new Uint8Array(await new Blob(parts).arrayBuffer());
}

// Some hosts unpack .gz files on the way.
async function unpack(bytes) {
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes;
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Removes files of older versions. */
export async function forgetOthers(version) {
  const cache = await globalThis.caches?.open(NAME).catch(() => null);
  for (const request of (await cache?.keys()) ?? []) if (!request.url.includes(`v=${version}`)) await cache.delete(request);
}
