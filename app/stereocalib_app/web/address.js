// The address says what is on show, so that a link or a reload opens it again; the title names drive and frame.
import { known, listen, want } from './link.js';
import { setRange, view } from './timeline.js';

function read() {
  const given = new URLSearchParams((window.stereocalibOpened || '').slice(1)), state = { set: given.getAll('set') };
  if (![...given.keys()].length) return null;
  if (given.has('at')) state.at = Number(given.get('at'));
  if (given.has('source')) state.source = given.get('source');
  if (given.has('own')) state.own = true;
  const camera = (given.get('camera') || '').split(',').map(Number);
  if (camera.length === 6 && camera.every(Number.isFinite)) state.camera = camera;
  const range = (given.get('range') || '').split('-').map(Number);
  if (range.length === 2 && range.every(Number.isFinite)) view.range = range;
  return state;
}

let opened = read(), due = null, settled = !opened;
want(opened);
// Until the server has answered, the address is what was asked for and not what is shown.
listen('page', () => { setTimeout(() => { settled = true; soon(); }, 600); });

function write() {
  due = null;
  if (!known.now || !settled) return;
  const state = JSON.parse(known.now.state), out = new URLSearchParams();
  out.set('at', state.at);
  for (const word of state.set) out.append('set', word);
  if (state.source) out.set('source', state.source);
  if (state.own) out.set('own', '1');
  if (known.camera) out.set('camera', known.camera.join(','));
  if (view.range) out.set('range', view.range.map(v => Math.round(v)).join('-'));
  const hash = `#${out.toString().replaceAll('%3A', ':').replaceAll('%2C', ',').replaceAll('%2F', '/')}`;
  if (hash !== location.hash) history.replaceState(null, '', location.pathname + location.search + hash);
}

function soon() { if (!due) due = setTimeout(write, 400); }
listen('now', now => {
  if (!now.playing) soon();
  const name = known.page ? known.page.name.split('?')[0] : '';
  const title = `${name}${name ? ' · ' : ''}frame ${now.frame} · stereocalib`;
  if (!now.playing && document.title !== title) document.title = title;
});
listen('camera', soon);
listen('range', soon);
listen('opened', ({ range }) => setRange(range));
