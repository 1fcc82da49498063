// What can be opened below the root: a list to search, with kind, frames and a picture; the latest first.
import { known, listen, send } from './link.js';

let shelf = null;
listen('shelf', ({ head }) => { shelf = head; });
listen('page', () => { shelf = null; });

const RECENT = 'stereocalib.opened';
function recent() { try { return JSON.parse(localStorage.getItem(RECENT)) || []; } catch { return []; } }
function remember(path) {
  try { localStorage.setItem(RECENT, JSON.stringify([path, ...recent().filter(p => p !== path)].slice(0, 12))); } catch { /* private */ }
}

class Shelf extends HTMLElement {
  connectedCallback() {
    this.innerHTML = `<input type="search" class="sc-search" placeholder="Search drives and runs" aria-label="Search drives and runs">
      <div class="sc-shelf" role="list" aria-label="Drives and runs"></div>`;
    this.box = this.querySelector('input'); this.list = this.querySelector('.sc-shelf');
    this.box.oninput = () => this.fill();
    this.offs = [listen('shelf', () => this.fill()), listen('page', () => this.ask())];
    this.ask(); this.fill();
  }

  disconnectedCallback() { this.offs.forEach(off => off()); }

  ask() { send({ t: 'shelf' }); }

  fill() {
    this.list.textContent = '';
    if (!shelf) { this.list.textContent = 'looking …'; return; }
    const words = this.box.value.toLowerCase().split(/\s+/).filter(Boolean), last = recent();
    const place = path => { const at = last.indexOf(path); return at < 0 ? last.length : at; };
    const found = shelf.found.filter(([path, kind]) => words.every(w => `${path} ${kind}`.toLowerCase().includes(w)))
      .sort((a, b) => place(a[0]) - place(b[0]) || b[3] - a[3]);
    if (!found.length) this.list.textContent = shelf.found.length ? 'nothing of that name' : `nothing to open below ${shelf.root}`;
    for (const [path, kind, frames] of found.slice(0, 60)) this.list.append(this.entry(path, kind, frames));
  }

  entry(path, kind, frames) {
    const button = document.createElement('button'), words = document.createElement('span');
    button.type = 'button'; button.setAttribute('role', 'listitem'); button.title = path;
    if (kind !== 'zip' && kind !== 'run') {
      const image = document.createElement('img');
      image.loading = 'lazy'; image.alt = ''; image.src = `/own/thumb?path=${encodeURIComponent(path)}`;
      image.onerror = () => image.remove();
      button.append(image);
    }
    const name = document.createElement('b'), small = document.createElement('small');
    name.textContent = path === '.' ? '(this folder)' : path;
    small.textContent = `${kind}${frames ? ` · ${frames} frames` : ''}${kind === 'boards' ? ' · stereocalib view-lidar' : ''}`;
    words.append(name, small); button.append(words);
    button.disabled = kind === 'boards';
    button.onclick = () => { remember(path); send({ t: 'open', path }); };
    return button;
  }
}
customElements.define('stereocalib-shelf', Shelf);
