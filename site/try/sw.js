// Keeps the page for use without a network, and asks the browser to let it share memory between threads, on hosts that
// cannot send those two headers. The model's large files are kept by files.js.
const NAME = 'motion-jax-page';

self.addEventListener('install', () => self.skipWaiting());
self.addEventListener('activate', (event) => event.waitUntil(self.clients.claim()));
self.addEventListener('fetch', (event) => {
  const url = new URL(event.request.url);
  if (event.request.method !== 'GET' || url.origin !== location.origin || url.searchParams.has('v')) return;
  event.respondWith((async () => {
    const cache = await caches.open(NAME);
    let response;
    try {
      response = await fetch(event.request); // newest first, the kept one without a network
      if (response.ok) await cache.put(event.request, response.clone()).catch(() => {});
    } catch (error) {
      response = await cache.match(event.request, {ignoreSearch: true});
      if (!response) throw error;
    }
    const headers = new Headers(response.headers);
    headers.set('Cross-Origin-Opener-Policy', 'same-origin');
    headers.set('Cross-Origin-Embedder-Policy', 'require-corp');
    return new Response(response.body, {status: response.status, statusText: response.statusText, headers});
  })());
});
