// Hot keys work after any click; `?` lists them; controls have names for those who do not see them.
import { known } from './link.js';

const TYPED = 'input:not([type=checkbox]):not([type=radio]):not([type=range]):not([readonly]):not([inputmode=none]), textarea, [contenteditable=true]';

// A click leaves the focus on a box or a list, where viser hears no keys. Who types, or walks by Tab, keeps it.
document.addEventListener('click', event => {
  if (event.detail === 0 && !event.target.closest('[role=option]')) return;
  setTimeout(() => {
    const active = document.activeElement;
    if (active && active !== document.body && !active.matches(TYPED) && !active.closest('dialog')
      && active.getAttribute('aria-expanded') !== 'true' && active.matches('input, button, select, [role=slider], canvas')) active.blur();
  }, 60);
}, true);

document.addEventListener('keydown', event => {
  const active = document.activeElement;
  if (active && active.matches(TYPED)) {
    if (event.key === 'Enter' || event.key === 'Escape') setTimeout(() => active.blur(), 50);
    return;
  }
  if (event.key === '?' && !event.ctrlKey && !event.metaKey) { event.preventDefault(); help(); }
}, true);

function help() {
  const old = document.querySelector('dialog.sc-help');
  if (old) { old.close(); return; }
  const dialog = document.createElement('dialog'), table = document.createElement('table');
  dialog.className = 'sc-help'; dialog.setAttribute('aria-label', 'Keys');
  dialog.append(Object.assign(document.createElement('h2'), { textContent: 'Keys' }), table);
  const rows = [...((known.page && known.page.keys) || []), ['Every command', 'K', 'ctrl'], ['This list', '?', null]];
  for (const [label, key, modifier] of rows) {
    const row = table.insertRow();
    row.insertCell().append(Object.assign(document.createElement('kbd'), { textContent: `${modifier ? `${modifier}+` : ''}${key}` }));
    row.insertCell().textContent = label;
  }
  const close = Object.assign(document.createElement('button'), { textContent: 'Close', type: 'button' });
  close.onclick = () => dialog.close();
  dialog.append(close); dialog.onclose = () => dialog.remove();
  document.body.append(dialog); dialog.showModal();
}

const NAMELESS = 'input:not([type=hidden]), textarea, select, button, [role=slider], [role=tab], img';

function named(e) {
  const by = (e.getAttribute('aria-labelledby') || '').split(' ').map(id => id && document.getElementById(id)?.textContent);
  return [e.getAttribute('aria-label'), e.getAttribute('alt'), e.title, e.placeholder, e.textContent, ...by,
    ...[...(e.labels || [])].map(label => label.textContent)].some(words => words && words.trim());
}

// viser leaves some controls without a name: theirs is the label that stands beside them, or above.
function name() {
  for (const e of document.querySelectorAll(NAMELESS)) {
    if (named(e)) continue;
    let around = e.parentElement, words = '';
    for (let up = 0; around && up < 7 && !words; up++, around = around.parentElement) {
      const label = [...around.querySelectorAll('label, p, legend')].find(l => l.textContent.trim());
      if (label) words = label.textContent.trim();
    }
    if (e.matches('button')) words = e.closest('[data-dock-root]') ? 'Panel' : words || 'Control';
    if (e.matches('img')) e.alt = words || 'picture';
    else if (words) e.setAttribute('aria-label', words.slice(0, 80));
  }
}
setInterval(name, 1000);
