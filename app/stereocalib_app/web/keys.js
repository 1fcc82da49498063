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

function name() {
  for (const thumb of document.querySelectorAll('.mantine-Slider-thumb:not([aria-label]), .mantine-Slider-thumb[aria-label=""]')) {
    let around = thumb.parentElement;
    while (around && !around.querySelector('label')) around = around.parentElement;
    const label = around && around.querySelector('label').textContent;
    if (label) thumb.setAttribute('aria-label', label);
  }
  for (const picture of document.querySelectorAll('img:not([alt]), img[alt=""]')) picture.alt = 'picture';
}
setInterval(name, 1000);
