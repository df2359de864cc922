// Motions load when they come near the screen and unload when they leave it: a browser draws few at a time.
const watcher = new IntersectionObserver((entries) => {
  for (const {target, isIntersecting} of entries) {
    if (isIntersecting && !target.hasAttribute('src')) target.src = target.dataset.src;
    if (!isIntersecting && target.hasAttribute('src')) {
      const fresh = target.cloneNode();  // an element without a page, in place of one that would add to the history
      fresh.removeAttribute('src');
      watcher.unobserve(target);
      target.replaceWith(fresh);
      watcher.observe(fresh);
    }
  }
}, {rootMargin: '200px'});
document.querySelectorAll('iframe.motion').forEach((frame) => watcher.observe(frame));
