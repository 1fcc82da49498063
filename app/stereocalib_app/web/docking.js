// Where this browser has put the panels: told to the server, which puts them there again after a reload or another drive.
import { known, listen, send } from './link.js';

const STORE = 'stereocalib.docking', MARKS = { views: 'stereocalib-picture', plots: 'stereocalib-timeline', main: 'stereocalib-me' };
let touched = 0;
known.docking = stored();

function stored() {
  try { return JSON.parse(localStorage.getItem(STORE)) || {}; } catch { return {}; }
}

// What is folded away has no content in the page: it stays as it was known.
function seen() {
  const found = { ...known.docking };
  for (const [name, mark] of Object.entries(MARKS)) {
    const inside = [...document.querySelectorAll(mark)].find(e => !e.closest('.sc-phone') && e.closest('[data-dock-root]'));
    if (!inside) continue;
    const region = inside.closest('[data-dock-region]'), window_ = inside.closest('[data-floating-window]');
    const box = (region || window_ || inside).getBoundingClientRect();
    if (!box.width) continue;
    if (region) found[name] = { at: region.dataset.dockRegion, width: Math.round(box.width) };
    else if (window_) {
      const root = inside.closest('[data-dock-root]').getBoundingClientRect();
      // From the lower edge where it is nearer, so that another height of the window keeps it in sight.
      const below = root.bottom - box.bottom, above = box.top - root.top;
      found[name] = { at: 'float', x: Math.round(box.left - root.left), y: Math.round(below < above ? -Math.max(1, below) : above), width: Math.round(box.width) };
    }
  }
  return found;
}

// Only what a person has moved is remembered: the page itself fits panels to the window.
document.addEventListener('pointerdown', event => {
  if (event.target.closest?.('[data-dock-region-handle], [data-floating-handle], [data-dock-column-handle], [data-dock-resize], [data-dock-region-resize], [data-dock-group]')) touched = performance.now();
}, true);
document.addEventListener('pointerup', () => {
  if (touched) setTimeout(look, 900);
}, true);

function look() {
  if (!touched) return;
  touched = 0;
  const now = seen(), before = JSON.stringify(known.docking);
  if (JSON.stringify(now) === before) return;
  known.docking = now;
  try { localStorage.setItem(STORE, JSON.stringify(now)); } catch { /* a private window */ }
  send({ t: 'docking', panels: now });
}

listen('forget docking', () => {
  known.docking = {};
  try { localStorage.removeItem(STORE); } catch { /* a private window */ }
});
