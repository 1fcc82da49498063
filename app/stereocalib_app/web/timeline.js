// The time line: rows of signals over the frames, drawn by ourselves so that a click leads to its frame.
import { flat, known, listen, send, tell } from './link.js';

const RULER = 18, MAP = 24, LEFT = 46, RIGHT = 8, LEAST_MARK = 3;
// Rows are lower in a low window, so that the map of the whole drive stays in sight.
const rowHeight = () => window.innerHeight < 760 ? 42 : 58;
const STORE = 'stereocalib.rows', DEFAULT = ['height', 'pitch', 'roll'];
const FAILED = 'rgba(213,94,0,0.38)', SHIFT = '#cc79a7', GAP = 'rgba(139,146,155,0.30)';

// Shared by every time line of this browser, and remembered.
export const view = { rows: stored(), range: null };

function stored() {
  try {
    const rows = JSON.parse(localStorage.getItem(STORE));
    return Array.isArray(rows) && rows.length ? rows : DEFAULT;
  } catch { return DEFAULT; }
}

export function setRange(range) {
  const total = data ? data.total : 0;
  if (range && total > 1) {
    let [a, b] = range[0] < range[1] ? range : [range[1], range[0]];
    const least = Math.min(4, total - 1);
    if (b - a < least) { const m = (a + b) / 2; a = m - least / 2; b = m + least / 2; }
    if (a < 0) { b -= a; a = 0; }
    if (b > total - 1) { a -= b - (total - 1); b = total - 1; }
    range = [Math.max(0, a), b];
    if (range[0] <= 0 && range[1] >= total - 1) range = null;
  }
  view.range = range;
  tell('range', range);
}

let data = null, asked = 0, waiting = false;

function ask(force) {
  const now = performance.now();
  if (!known.now || waiting && now - asked < 5000) return;
  if (!force && (data && data.version === known.now.version || now - asked < 700)) return;
  asked = now; waiting = true;
  send({ t: 'signals', names: view.rows });
}

function unpack({ head, body }) {
  let at = 0;
  const take = () => { const part = new Float32Array(body, at, head.total); at += 4 * head.total; return part; };
  const times = take();
  const rows = head.rows.map(row => ({ ...row, traces: row.traces.map(([name, color, style, sigma]) =>
    ({ name, color, style, values: take(), sigma: sigma ? take() : null })) }));
  rows.sort((a, b) => view.rows.indexOf(a.key) - view.rows.indexOf(b.key));
  return { ...head, times, rows };
}

listen('signals', message => {
  waiting = false;
  data = unpack(message);
  if (view.range && view.range[1] > data.total - 1) setRange(null);
  tell('data', data);
});
listen('now', () => ask(false));
listen('page', () => { data = null; waiting = false; setRange(view.range); ask(true); });
setInterval(() => ask(false), 800);

function short(value, unit) {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  const digits = unit === 'm' || unit === '°' ? 3 : size >= 1000 ? 0 : size >= 100 ? 1 : size >= 1 ? 2 : 3;
  return value.toFixed(digits).replace('-', '−');
}

function ticks(low, high, count) {
  const raw = (high - low) / Math.max(1, count), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= raw * 0.999) || power * 10;
  const found = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push(v);
  return [found, step];
}

function rowRange(row, a, b) {
  const all = [];
  for (const trace of row.traces) {
    for (let i = Math.max(0, Math.floor(a)); i <= Math.min(data.total - 1, Math.ceil(b)); i++) {
      if (Number.isFinite(trace.values[i])) all.push(trace.values[i]);
    }
  }
  if (!all.length) return [0, 1];
  all.sort((x, y) => x - y);
  // A few values far out must not make all others a line; what lies beyond is drawn at the edge.
  let low = all[Math.floor(0.005 * (all.length - 1))], high = all[Math.ceil(0.995 * (all.length - 1))];
  const span = Math.max(high - low, row.span, 1e-6 * Math.max(1, Math.abs(high)));
  const middle = (low + high) / 2;
  return [middle - 0.62 * span, middle + 0.62 * span];
}

class TimeLine extends HTMLElement {
  connectedCallback() {
    this.innerHTML = `<div class="sc-bar"><button type="button" class="sc-pick" aria-expanded="false">Signals…</button>
      <button type="button" class="sc-all" disabled>Whole drive</button><span class="sc-note"></span></div>
      <div class="sc-list" hidden></div>
      <canvas class="sc-time" role="slider" tabindex="0" aria-label="Time line" aria-valuemin="0"></canvas>`;
    this.canvas = this.querySelector('canvas');
    this.base = document.createElement('canvas');
    this.note = this.querySelector('.sc-note');
    this.list = this.querySelector('.sc-list');
    this.all = this.querySelector('.sc-all');
    this.all.onclick = () => setRange(null);
    this.querySelector('.sc-pick').onclick = event => {
      this.list.hidden = !this.list.hidden;
      event.target.setAttribute('aria-expanded', String(!this.list.hidden));
      this.fill();
    };
    this.pointer = null; this.drag = null;
    this.offs = [listen('data', () => this.stale()), listen('now', () => this.draw()),
      listen('range', () => this.stale()), listen('rows', () => this.stale())];
    this.sizes = new ResizeObserver(() => this.stale());
    this.sizes.observe(this);
    this.themes = new MutationObserver(() => this.stale());
    this.themes.observe(document.documentElement, { attributes: true, attributeFilter: ['data-mantine-color-scheme'] });
    const c = this.canvas;
    c.onpointerdown = e => this.down(e);
    c.onpointermove = e => this.move(e);
    c.onpointerup = e => this.up(e);
    c.onpointercancel = () => { this.drag = null; this.draw(); };
    c.onpointerleave = () => { this.pointer = null; this.draw(); };
    c.ondblclick = () => { setRange(null); if (this.before != null) send({ t: 'seek', frame: this.before }); };
    c.addEventListener('wheel', e => this.wheel(e), { passive: false });
    this.stale(); ask(true);
  }

  disconnectedCallback() { this.offs.forEach(off => off()); this.sizes.disconnect(); this.themes.disconnect(); }

  stale() { this.fresh = false; this.all.disabled = !view.range; this.fill(); this.draw(); }

  range() { return view.range || [0, Math.max(1, (data ? data.total : 2) - 1)]; }

  x(frame) { const [a, b] = this.range(); return LEFT + (frame - a) / (b - a) * (this.w - LEFT - RIGHT); }

  frameAt(x) { const [a, b] = this.range(); return a + (x - LEFT) / (this.w - LEFT - RIGHT) * (b - a); }

  mapFrame(x) { return (x - LEFT) / (this.w - LEFT - RIGHT) * (data.total - 1); }

  clamp(frame) { return Math.round(Math.min(Math.max(frame, 0), data.total - 1)); }

  fill() {
    if (this.list.hidden || !data || this.filled === data.all.length + view.rows.join()) return;
    this.filled = data.all.length + view.rows.join();
    this.list.textContent = '';
    let group = null, box = null;
    for (const [key, label, unit, name] of data.all) {
      if (name !== group) {
        box = document.createElement('fieldset');
        box.append(Object.assign(document.createElement('legend'), { textContent: name }));
        this.list.append(box); group = name;
      }
      const line = document.createElement('label'), tick = document.createElement('input');
      tick.type = 'checkbox'; tick.checked = view.rows.includes(key);
      tick.onchange = () => {
        view.rows = tick.checked ? [...view.rows, key] : view.rows.filter(k => k !== key);
        try { localStorage.setItem(STORE, JSON.stringify(view.rows)); } catch { /* a private window */ }
        ask(true); waiting = false; ask(true); tell('rows');
      };
      line.append(tick, ` ${label}${unit ? ` [${unit}]` : ''}`);
      box.append(line);
    }
  }

  paint() {
    const ratio = window.devicePixelRatio || 1;
    this.w = Math.max(160, this.canvas.clientWidth);
    const rows = data ? data.rows.length : view.rows.length;
    this.step = rowHeight();
    this.h = RULER + this.step * Math.max(1, rows) + MAP;
    for (const c of [this.canvas, this.base]) { c.width = this.w * ratio; c.height = this.h * ratio; }
    this.canvas.style.height = `${this.h}px`;
    const g = this.base.getContext('2d', flat);
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(this);
    this.ink = style.getPropertyValue('--mantine-color-text').trim() || '#ddd';
    this.soft = '#8b929b';
    this.paper = style.getPropertyValue('--mantine-color-body').trim() || '#222';
    g.font = '11px system-ui, sans-serif';
    if (!data || data.total < 1) { g.fillStyle = this.soft; g.fillText('waiting for the first frames', LEFT, 40); this.fresh = true; return; }
    const [a, b] = this.range();
    this.marks(g, f => this.x(f), RULER, this.h - MAP, true);
    const [frames] = ticks(a, b, (this.w - LEFT) / 80);
    g.fillStyle = this.soft; g.textAlign = 'center';
    for (const f of frames) {
      if (Math.abs(f - Math.round(f)) > 1e-6) continue;
      const x = this.x(f);
      g.fillText(String(Math.round(f)), x, 11);
      g.fillStyle = 'rgba(139,146,155,0.18)'; g.fillRect(x, RULER, 1, this.h - MAP - RULER); g.fillStyle = this.soft;
    }
    g.textAlign = 'left'; g.fillText('frame', 4, 11);
    data.rows.forEach((row, i) => this.row(g, row, RULER + i * this.step, a, b));
    this.map(g);
    this.fresh = true;
  }

  marks(g, x, top, bottom, words) {
    const span = (first, last, fill) => {
      const left = x(first - 0.5), width = Math.max(LEAST_MARK, x(last + 0.5) - left);
      if (left + width < LEFT || left > this.w - RIGHT) return;
      const from = Math.max(LEFT, left);
      g.fillStyle = fill; g.fillRect(from, top, Math.min(left + width, this.w - RIGHT) - from, bottom - top);
    };
    for (const [first, last] of data.gaps) span(first, last, GAP);
    for (const [first, last] of data.failed) span(first, last, FAILED);
    for (const [frame] of data.shifts) {
      const at = x(frame);
      if (at < LEFT || at > this.w - RIGHT) continue;
      g.fillStyle = SHIFT; g.fillRect(at - 1.5, top, LEAST_MARK, bottom - top);
      if (words) { g.beginPath(); g.moveTo(at - 1, top); g.lineTo(at + 9, top + 5); g.lineTo(at - 1, top + 10); g.fill(); }
    }
  }

  row(g, row, top, a, b) {
    const [low, high] = rowRange(row, a, b), inner = top + 14, height = this.step - 17;
    const y = v => inner + height - (Math.min(Math.max(v, low), high) - low) / (high - low) * height;
    g.fillStyle = 'rgba(139,146,155,0.25)'; g.fillRect(0, top + this.step - 1, this.w, 1);
    g.fillStyle = this.soft; g.textAlign = 'right'; g.font = '10px system-ui, sans-serif';
    const [marks, step] = ticks(low, high, 3);
    const digits = Math.max(0, Math.min(4, -Math.floor(Math.log10(step) + 1e-9)));
    for (const v of marks) {
      const at = y(v); g.fillText(v.toFixed(digits).replace('-', '−'), LEFT - 4, at + 3);
      g.fillStyle = 'rgba(139,146,155,0.18)'; g.fillRect(LEFT, at, this.w - LEFT - RIGHT, 1); g.fillStyle = this.soft;
    }
    g.save(); g.beginPath(); g.rect(LEFT, inner - 1, this.w - LEFT - RIGHT, height + 2); g.clip();
    for (const limit of row.limits) {
      if (limit == null || limit < low || limit > high) continue;
      g.strokeStyle = '#d55e00'; g.setLineDash([2, 3]); g.beginPath(); g.moveTo(LEFT, y(limit)); g.lineTo(this.w, y(limit)); g.stroke(); g.setLineDash([]);
    }
    const first = Math.max(0, Math.floor(a) - 1), last = Math.min(data.total - 1, Math.ceil(b) + 1);
    for (const t of row.traces) if (t.sigma) this.band(g, t, y, first, last);
    for (const t of row.traces) (t.style === 'dots' ? this.dots : this.line).call(this, g, t, y, first, last, high - low);
    g.restore();
    g.font = '11px system-ui, sans-serif'; g.textAlign = 'left';
    row.top = top;
  }

  // Runs of known values; what is missing is never bridged.
  runs(t, first, last, draw) {
    let from = -1;
    for (let i = first; i <= last + 1; i++) {
      const ok = i <= last && Number.isFinite(t.values[i]);
      if (ok && from < 0) from = i;
      if (!ok && from >= 0) { draw(from, i - 1); from = -1; }
    }
  }

  band(g, t, y, first, last) {
    g.globalAlpha = 0.25; g.fillStyle = t.color;
    const stride = Math.max(1, Math.floor((last - first) / (1.5 * this.w)));
    this.runs(t, first, last, (i, j) => {
      g.beginPath();
      for (let k = i; k <= j; k += stride) g.lineTo(this.x(k), y(t.values[k] + (t.sigma[k] || 0)));
      for (let k = j; k >= i; k -= stride) g.lineTo(this.x(k), y(t.values[k] - (t.sigma[k] || 0)));
      g.fill();
    });
    g.globalAlpha = 1;
  }

  line(g, t, y, first, last) {
    g.strokeStyle = t.color; g.lineWidth = t.style === 'dashed' ? 1.3 : 1.8; g.setLineDash(t.style === 'dashed' ? [4, 3] : []);
    const perPixel = (last - first) / Math.max(1, this.w - LEFT - RIGHT);
    g.beginPath();
    this.runs(t, first, last, (i, j) => {
      if (i === j) { g.moveTo(this.x(i) - 1, y(t.values[i])); g.lineTo(this.x(i) + 1, y(t.values[i])); return; }
      if (perPixel < 1.5) { g.moveTo(this.x(i), y(t.values[i])); for (let k = i + 1; k <= j; k++) g.lineTo(this.x(k), y(t.values[k])); return; }
      let column = null, low = 0, high = 0, begun = false;
      const flush = () => { const x = column + 0.5; if (begun) g.lineTo(x, y(low)); else { g.moveTo(x, y(low)); begun = true; } if (high !== low) g.lineTo(x, y(high)); };
      for (let k = i; k <= j; k++) {
        const at = Math.floor(this.x(k)), v = t.values[k];
        if (at !== column) { if (column !== null) flush(); column = at; low = high = v; } else { low = Math.min(low, v); high = Math.max(high, v); }
      }
      flush();
    });
    g.stroke(); g.setLineDash([]);
  }

  dots(g, t, y, first, last) {
    g.fillStyle = t.color;
    const size = last - first < 150 ? 4 : 2.5;
    for (let k = first; k <= last; k++) if (Number.isFinite(t.values[k])) g.fillRect(this.x(k) - size / 2, y(t.values[k]) - size / 2, size, size);
  }

  map(g) {
    const top = this.h - MAP + 4, bottom = this.h - 3, width = this.w - LEFT - RIGHT, x = f => LEFT + f / Math.max(1, data.total - 1) * width;
    g.fillStyle = 'rgba(139,146,155,0.16)'; g.fillRect(LEFT, top, width, bottom - top);
    this.marks(g, x, top, bottom, false);
    const row = data.rows[0], t = row && (row.traces.find(s => s.sigma && s.style === 'line') || row.traces[0]);
    if (t) {
      const [low, high] = rowRange(row, 0, data.total - 1);
      g.strokeStyle = t.color; g.lineWidth = 1; g.beginPath();
      this.runs(t, 0, data.total - 1, (i, j) => {
        const stride = Math.max(1, Math.floor(data.total / width));
        for (let k = i; k <= j; k += stride) {
          const at = bottom - 2 - (Math.min(Math.max(t.values[k], low), high) - low) / (high - low) * (bottom - top - 4);
          if (k === i) g.moveTo(x(k), at); else g.lineTo(x(k), at);
        }
      });
      g.stroke();
    }
    if (view.range) {
      g.strokeStyle = this.ink; g.lineWidth = 1.5;
      g.strokeRect(x(view.range[0]), top, Math.max(4, x(view.range[1]) - x(view.range[0])), bottom - top);
    }
    this.mapX = x;
  }

  draw() {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => { this.due = false; if (this.isConnected) this.compose(); });
  }

  compose() {
    if (!this.fresh || Math.max(160, this.canvas.clientWidth) !== this.w) this.paint();
    const ratio = window.devicePixelRatio || 1, g = this.canvas.getContext('2d', flat);
    g.setTransform(1, 0, 0, 1, 0, 0); g.clearRect(0, 0, this.canvas.width, this.canvas.height);
    g.drawImage(this.base, 0, 0);
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    const now = known.now;
    if (!data || !now || data.total < 1) return;
    const frame = now.frame, x = this.x(frame);
    this.canvas.setAttribute('aria-valuenow', frame); this.canvas.setAttribute('aria-valuemax', data.total - 1);
    g.fillStyle = this.ink;
    if (x >= LEFT && x <= this.w - RIGHT) g.fillRect(x - 1, RULER, 2, this.h - MAP - RULER);
    g.fillRect(this.mapX(frame) - 1, this.h - MAP + 2, 2, MAP - 4);
    g.font = '11px system-ui, sans-serif';
    for (const row of data.rows) this.values(g, row, frame, row.top + 11, LEFT + 4, this.w - RIGHT);
    if (this.drag && this.drag.zoom) {
      g.fillStyle = 'rgba(86,180,233,0.25)';
      g.fillRect(Math.min(this.drag.x, this.drag.to), RULER, Math.abs(this.drag.to - this.drag.x), this.h - MAP - RULER);
    }
    this.told(g, frame);
  }

  values(g, row, frame, y, x, end) {
    const parts = [[this.ink, `${row.label} `]];
    for (const t of row.traces) {
      const v = t.values[frame], s = t.sigma ? t.sigma[frame] : NaN;
      parts.push([this.tone(t.color), `${t.name} ${short(v, row.unit)}${Number.isFinite(s) && Number.isFinite(v) ? ` ± ${short(s, row.unit)}` : ''}  `]);
    }
    parts.push([this.soft, row.unit]);
    for (const [color, text] of parts) {
      const width = g.measureText(text).width;
      if (x + width > end) break;
      g.fillStyle = color; g.fillText(text, x, y); x += width;
    }
  }

  // On white paper a colour of the dark page is too faint for letters.
  tone(color) {
    if (document.documentElement.dataset.mantineColorScheme !== 'light') return color;
    const [r, g, b] = color.match(/[\d.]+/g).map(v => Math.round(0.66 * v));
    return `rgb(${r},${g},${b})`;
  }

  told(g, frame) {
    let words = `frame ${frame} · ${data.times[frame].toFixed(2)} s`;
    if (this.pointer && this.pointer.x >= LEFT) {
      const over = this.clamp(this.pointer.y > this.h - MAP ? this.mapFrame(this.pointer.x) : this.frameAt(this.pointer.x));
      const failed = data.failed.find(([f, l]) => over >= f && over <= l), shift = this.near(over, data.shifts), gap = data.gaps.find(([f, l]) => over >= f && over <= l);
      words = `pointer: frame ${over} · ${data.times[over].toFixed(2)} s`;
      if (failed) words += ` · failed ${failed[0] === failed[1] ? '' : `${failed[0]}–${failed[1]} `}${failed[2]}`;
      if (shift) words += ` · ${shift[1]}`;
      if (gap && !failed) words += ` · no odometry ${gap[0]}–${gap[1]}`;
      if (this.pointer.y <= this.h - MAP) {
        const x = this.x(over); g.fillStyle = this.soft; g.fillRect(x - 0.5, RULER, 1, this.h - MAP - RULER);
        for (const row of data.rows) {
          const text = row.traces.map(t => short(t.values[over], row.unit)).filter(s => s !== '–').join(' / ') || '–';
          const width = g.measureText(text).width + 8, left = x + width + 6 > this.w ? x - width - 4 : x + 4;
          g.fillStyle = this.paper; g.globalAlpha = 0.85; g.fillRect(left, row.top + this.step - 18, width, 14); g.globalAlpha = 1;
          g.fillStyle = this.ink; g.fillText(text, left + 4, row.top + this.step - 7);
        }
      }
    }
    if (this.note.textContent !== words) this.note.textContent = words;
  }

  near(frame, shifts) {
    const [a, b] = this.range(), reach = Math.max(1, (b - a) / this.w * 6);
    return shifts.find(([f]) => Math.abs(f - frame) <= reach);
  }

  place(e) { const box = this.canvas.getBoundingClientRect(); return { x: e.clientX - box.left, y: e.clientY - box.top }; }

  seek(frame) {
    this.wanted = this.clamp(frame);
    if (this.sent) return;
    // As fast as the screen, and the latest wish wins.
    this.sent = true;
    send({ t: 'seek', frame: this.wanted });
    const last = this.wanted;
    setTimeout(() => { this.sent = false; if (this.wanted !== last) this.seek(this.wanted); }, 40);
  }

  down(e) {
    if (!data || e.button !== 0) return;
    const p = this.place(e);
    try { this.canvas.setPointerCapture(e.pointerId); } catch { /* a pointer that is gone */ }
    const map = p.y > this.h - MAP, ruler = p.y < RULER;
    this.drag = { x: p.x, to: p.x, map, ruler, zoom: false, range: view.range };
    if (ruler) this.seek(this.frameAt(p.x));
    if (map && !view.range) this.seek(this.mapFrame(p.x));
  }

  move(e) {
    if (!data) return;
    this.pointer = this.place(e);
    const d = this.drag;
    if (d) {
      d.to = this.pointer.x;
      if (d.ruler) this.seek(this.frameAt(d.to));
      else if (d.map && !d.range) this.seek(this.mapFrame(d.to));
      else if (d.map) { const by = this.mapFrame(d.to) - this.mapFrame(d.x); d.moved = Math.abs(d.to - d.x) > 3; setRange([d.range[0] + by, d.range[1] + by]); }
      else if (Math.abs(d.to - d.x) > 5) d.zoom = true;
    }
    this.draw();
  }

  up(e) {
    const d = this.drag; this.drag = null;
    if (!d || !data) return;
    if (d.zoom) setRange([this.frameAt(d.x), this.frameAt(d.to)]);
    else if (d.map && d.range && !d.moved) this.seek(this.mapFrame(d.x));
    else if (!d.map && !d.ruler) {
      if (e.detail !== 2) this.before = known.now ? known.now.frame : null;
      this.seek(this.frameAt(d.x));
    }
    this.draw();
  }

  wheel(e) {
    if (!data || !(e.ctrlKey || e.shiftKey || e.metaKey)) return;
    e.preventDefault();
    const [a, b] = this.range(), at = this.frameAt(this.place(e).x), delta = e.deltaY || e.deltaX;
    const by = Math.exp(0.0015 * delta);
    setRange([at + (a - at) * by, at + (b - at) * by]);
  }
}
customElements.define('stereocalib-timeline', TimeLine);
