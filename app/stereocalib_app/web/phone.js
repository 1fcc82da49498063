// On a phone: picture, time line and card one below the other, over viser's own page, which a button brings back.
import { known, listen, send } from './link.js';

const NARROW = window.matchMedia('(max-width: 36em)'); // as viser's own limit for phones
const BUTTONS = [['failure before', '◀ failure', 'Previous failure'], ['back', '◀', 'Step back'], ['play', 'Play', 'Play or pause'],
  ['on', '▶', 'Step on'], ['failure', 'failure ▶', 'Next failure']];
let simple = true, page = null, card = null, asked = -1;

function build() {
  page = document.createElement('main');
  page.className = 'sc-phone'; page.setAttribute('aria-label', 'stereocalib');
  page.innerHTML = `<header><b class="sc-name"></b><button type="button" class="sc-leave">3-D and controls</button></header>
    <p class="sc-state" role="status"></p><stereocalib-picture></stereocalib-picture><nav class="sc-move"></nav>
    <stereocalib-timeline></stereocalib-timeline><section class="sc-card" aria-label="Results"></section>`;
  const move = page.querySelector('nav');
  for (const [what, text, name] of BUTTONS) {
    const button = Object.assign(document.createElement('button'), { type: 'button', textContent: text });
    button.setAttribute('aria-label', name); button.dataset.what = what;
    button.onclick = () => send({ t: 'move', what });
    move.append(button);
  }
  page.querySelector('.sc-leave').onclick = () => { simple = false; lay(); };
  document.body.append(page);
}

const back = Object.assign(document.createElement('button'), { type: 'button', textContent: 'Picture and card', className: 'sc-back' });
back.onclick = () => { simple = true; lay(); };

function lay() {
  const wanted = NARROW.matches && simple;
  if (wanted && !page) { build(); tell(); askCard(); }
  if (!wanted && page) { page.remove(); page = null; asked = -1; }
  if (NARROW.matches && !simple) document.body.append(back); else back.remove();
}

function tell() {
  if (!page || !known.now) return;
  const now = known.now;
  const failed = now.reason && now.reason !== 'OK';
  const words = `Frame ${now.frame} of ${now.total - 1} · ${now.time_s.toFixed(2)} s · `
    + (now.frame >= now.computed ? 'not computed yet' : failed ? `failed: ${now.reason}` : 'ok')
    + (now.done ? '' : ` · computing ${Math.round(100 * now.computed / Math.max(1, now.total))} %`);
  const state = page.querySelector('.sc-state');
  if (state.textContent !== words) state.textContent = words;
  state.classList.toggle('sc-failed', Boolean(failed));
  const play = page.querySelector('[data-what=play]'), label = now.playing ? 'Pause' : 'Play';
  if (play.textContent !== label) play.textContent = label;
  const name = known.page ? known.page.name : '';
  if (page.querySelector('.sc-name').textContent !== name) page.querySelector('.sc-name').textContent = name;
}

// The card is the server's own HTML, with every string from outside escaped there.
function askCard() {
  if (!page || !known.now || asked === known.now.version) return;
  asked = known.now.version; send({ t: 'card' });
}

listen('card', ({ head }) => { card = head.html; if (page) page.querySelector('.sc-card').innerHTML = card; });
listen('now', () => { tell(); askCard(); });
listen('page', () => { asked = -1; tell(); askCard(); });
NARROW.addEventListener('change', lay);
lay();
