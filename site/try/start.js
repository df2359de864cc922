// Runs before the page's modules, which a browser blocks in a page that was opened as a file.
function stopped(text) {
  document.getElementById('loading').hidden = true;
  Object.assign(document.getElementById('note'), {textContent: text, hidden: false, className: 'error'});
  document.body.dataset.state = 'failed';
}

function scriptFailed() {
  if (location.protocol !== 'file:') stopped('The page\'s script main.js did not arrive; check the connection, then load the page again.');
}

if (location.protocol === 'file:') {
  stopped('A browser runs this page only from a web server: python -m http.server -d FOLDER, then open http://localhost:8000.');
}
