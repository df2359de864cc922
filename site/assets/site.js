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

// The model in this tab: it loads when its form is sent, in place of the motion above the form.
const form = document.querySelector('form.try');
if (form) {
  form.onsubmit = (event) => {
    event.preventDefault();
    const page = document.createElement('iframe');
    page.className = 'running';
    page.title = 'The model in this tab';
    page.src = `${form.getAttribute('action')}?prompt=${encodeURIComponent(form.prompt.value)}`;
    form.closest('.demo').replaceChildren(page);
  };
}
