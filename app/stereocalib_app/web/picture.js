// The picture of the stage on show: native resolution, zoom and pan without the server, and what is under the pointer.
import { flat, known, listen, send } from './link.js';

let disparity = null, asked = -1;
listen('disparity', ({ head, body }) => { disparity = { ...head, values: new Uint16Array(body) }; });

function under(u, v) {
  const camera = known.page && known.page.camera, now = known.now;
  if (!camera || !now) return '';
  let words = `u ${u.toFixed(1)}  v ${v.toFixed(1)} px`;
  if (!disparity || disparity.frame !== now.frame) {
    if (!now.playing && asked !== now.frame) { asked = now.frame; send({ t: 'disparity', frame: now.frame }); }
    return words;
  }
  const [w, h] = disparity.size, step = disparity.step;
  const column = Math.floor((u + 0.5) / step), row = Math.floor((v + 0.5) / step);
  if (!w || column < 0 || row < 0 || column >= w || row >= h) return words;
  const d = disparity.values[row * w + column] / disparity.scale;
  if (!(d > 0)) return `${words}  · no disparity`;
  words += `  · disparity ${d.toFixed(2)} px`;
  if (!disparity.road) return words;
  const [, , f, cx, cy, b] = camera, [height, pitch, roll] = disparity.road;
  // eq. 13 and 14, and the same for the height over the road.
  const x = u - cx, y = v - cy, s = b / d, down = Math.cos(pitch) * y + Math.sin(pitch) * f;
  const X = s * (Math.cos(roll) * x + Math.sin(roll) * down), Z = s * (f * Math.cos(pitch) - Math.sin(pitch) * y);
  const over = height - s * (Math.cos(roll) * down - Math.sin(roll) * x);
  return `${words}  · X ${X.toFixed(2)}  Z ${Z.toFixed(2)} m  · ${over.toFixed(2)} m over the road`.replaceAll('-', '−');
}

class Picture extends HTMLElement {
  connectedCallback() {
    this.innerHTML = `<div class="sc-large"><canvas class="sc-picture" role="img" tabindex="0"></canvas>
      <div class="sc-read" aria-live="off"></div><div class="sc-tools"><span class="sc-legend"></span><span class="sc-buttons">
      <button type="button" data-do="in" aria-label="Zoom in">+</button><button type="button" data-do="out" aria-label="Zoom out">−</button>
      <button type="button" data-do="one" aria-label="One picture pixel a screen pixel">1:1</button>
      <button type="button" data-do="fit" aria-label="Whole picture">Fit</button>
      <button type="button" data-do="full" aria-label="Picture over the whole window">Large</button>
      <button type="button" data-do="save" aria-label="Save this picture as PNG">PNG</button></span></div></div><div class="sc-thumbs"></div>`;
    this.large = this.querySelector('.sc-large');
    this.canvas = this.querySelector('canvas');
    this.read = this.querySelector('.sc-read');
    this.legend = this.querySelector('.sc-legend');
    this.thumbs = this.querySelector('.sc-thumbs');
    this.zoom = 1; this.at = [0.5, 0.5];
    this.offs = [listen('picture', () => this.show()), listen('now', () => this.say()), listen('disparity', () => this.say())];
    this.sizes = new ResizeObserver(() => this.draw());
    this.sizes.observe(this.large);
    const c = this.canvas;
    c.addEventListener('wheel', e => { e.preventDefault(); this.scale(Math.exp(-0.0016 * e.deltaY), this.place(e)); }, { passive: false });
    this.fingers = new Map();
    c.onpointerdown = e => this.down(e);
    c.onpointerup = c.onpointercancel = e => { this.fingers.delete(e.pointerId); this.drag = null; };
    c.onpointermove = e => this.move(e);
    c.onpointerleave = () => { this.pointer = null; this.say(); };
    c.ondblclick = () => this.fit();
    for (const button of this.querySelectorAll('.sc-tools button')) button.onclick = () => this.act(button.dataset.do);
    this.show();
  }

  disconnectedCallback() { this.offs.forEach(off => off()); this.sizes.disconnect(); this.dialog?.remove(); }

  place(e) { const box = this.canvas.getBoundingClientRect(); return [e.clientX - box.left, e.clientY - box.top]; }

  fit() { this.zoom = 1; this.at = [0.5, 0.5]; this.draw(); }

  act(what) {
    const middle = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2];
    if (what === 'in') this.scale(1.5, middle);
    if (what === 'out') this.scale(1 / 1.5, middle);
    if (what === 'fit') this.fit();
    if (what === 'one' && known.picture) this.scale(1 / this.zoom / this.base() / (window.devicePixelRatio || 1), middle);
    if (what === 'full') this.full();
    if (what === 'save') this.save();
  }

  full() {
    if (this.dialog) { this.dialog.close(); return; }
    const dialog = document.createElement('dialog');
    dialog.className = 'sc-full'; dialog.setAttribute('aria-label', 'Picture');
    dialog.append(this.large); document.body.append(dialog);
    dialog.onclose = () => { this.prepend(this.large); dialog.remove(); this.dialog = null; this.fit(); };
    this.dialog = dialog; dialog.showModal(); this.fit();
  }

  save() {
    const { large, head } = known.picture || {};
    if (!large) return;
    const whole = new OffscreenCanvas(large.width, large.height);
    whole.getContext('2d', flat).drawImage(large, 0, 0);
    whole.convertToBlob({ type: 'image/png' }).then(blob => {
      const link = document.createElement('a'), name = (known.page ? known.page.name : 'drive').replace(/[^\w.-]+/g, '_').slice(0, 60);
      link.href = URL.createObjectURL(blob);
      link.download = `${name}_frame${head.frame}_${known.now.layout.replace(/[^\w-]+/g, '_')}.png`;
      link.click(); setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }

  // Screen pixels a picture pixel when the whole picture is in sight.
  base() {
    const { large } = known.picture;
    return Math.min(this.w / large.width, this.h / large.height);
  }

  scale(by, [x, y]) {
    if (!known.picture) return;
    const [px, py] = this.pixel(x, y), { large } = known.picture;
    this.zoom = Math.min(Math.max(this.zoom * by, 1), 60);
    const k = this.base() * this.zoom;
    this.at = [(px - (x - this.w / 2) / k) / large.width, (py - (y - this.h / 2) / k) / large.height];
    this.hold(); this.draw();
  }

  hold() {
    const { large } = known.picture, k = this.base() * this.zoom;
    const half = [this.w / 2 / k / large.width, this.h / 2 / k / large.height];
    this.at = this.at.map((v, i) => half[i] >= 0.5 ? 0.5 : Math.min(Math.max(v, half[i]), 1 - half[i]));
  }

  // Picture pixel (edges at whole numbers) under a point of the canvas.
  pixel(x, y) {
    const { large } = known.picture, k = this.base() * this.zoom;
    return [this.at[0] * large.width + (x - this.w / 2) / k, this.at[1] * large.height + (y - this.h / 2) / k];
  }

  down(e) {
    this.drag = this.place(e); this.start = [...this.at];
    this.fingers.set(e.pointerId, this.drag);
    try { this.canvas.setPointerCapture(e.pointerId); } catch { /* gone */ }
  }

  move(e) {
    const p = this.pointer = this.place(e);
    if (this.fingers.size === 2 && this.fingers.has(e.pointerId)) {
      const apart = () => { const [a, b] = [...this.fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
      const before = apart();
      this.fingers.set(e.pointerId, p);
      const [a, b] = [...this.fingers.values()];
      this.drag = null;
      this.scale(apart() / Math.max(before, 1), [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
      return;
    }
    if (this.drag && known.picture) {
      const { large } = known.picture, k = this.base() * this.zoom;
      this.at = [this.start[0] - (p[0] - this.drag[0]) / k / large.width, this.start[1] - (p[1] - this.drag[1]) / k / large.height];
      this.hold(); this.draw();
    }
    this.say();
  }

  say() {
    let words = '';
    if (this.pointer && known.picture) {
      const { head } = known.picture, [px, py] = this.pixel(...this.pointer);
      const across = px / head.size[0] * head.extent[0], down = py / head.size[1] * head.extent[1];
      if (px < 0 || py < 0 || px > head.size[0] || py > head.size[1]) words = '';
      else if (head.axes === 'image') words = under(across - 0.5, down - 0.5);
      else if (head.axes === 'u-disparity') words = `column u ${across.toFixed(1)} px  · disparity ${down.toFixed(2)} px`;
      else words = `disparity ${across.toFixed(2)} px  · row v ${down.toFixed(1)} px`;
    }
    this.read.textContent = words || (window.matchMedia('(pointer: coarse)').matches ? 'Two fingers zoom, one moves, a tap reads off.' : 'Wheel zooms, dragging moves, the pointer reads off.');
  }

  show() {
    if (!known.picture) return;
    const { head } = known.picture;
    if (head.axes + head.size[0] / head.size[1] !== this.shape) { this.shape = head.axes + head.size[0] / head.size[1]; this.zoom = 1; this.at = [0.5, 0.5]; }
    const legend = head.legend.map(([name, color]) => `${name}|${color}`).join();
    if (legend !== this.legendShown) {
      this.legendShown = legend; this.legend.textContent = '';
      for (const [name, color] of head.legend) {
        const entry = document.createElement('span'), mark = document.createElement('i');
        mark.style.background = color; entry.append(mark, name); this.legend.append(entry);
      }
    }
    this.canvas.setAttribute('aria-label', `${known.now ? known.now.layout : ''} of frame ${head.frame}`);
    this.sheet(); this.draw(); this.say();
  }

  sheet() {
    const { head, sheet } = known.picture, names = head.thumbs.map(t => t[0]).join();
    if (names !== this.names) {
      this.names = names; this.thumbs.textContent = '';
      for (const [name] of head.thumbs) {
        const button = document.createElement('button'), small = document.createElement('canvas'), label = document.createElement('span');
        button.type = 'button'; button.setAttribute('aria-label', `Show ${name} large`); button.dataset.name = name;
        label.textContent = name; button.append(small, label);
        button.onclick = () => send({ t: 'stage', name });
        this.thumbs.append(button);
      }
    }
    const k = sheet.width / 640;
    head.thumbs.forEach(([name, x, y, w, h], i) => {
      const button = this.thumbs.children[i], small = button.firstChild;
      if (small.width !== w || small.height !== h) { small.width = w; small.height = h; }
      small.getContext('2d', flat).drawImage(sheet, x * k, y * k, w * k, h * k, 0, 0, w, h);
      button.setAttribute('aria-pressed', String(known.now ? known.now.layout === name : false));
    });
  }

  draw() {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => { this.due = false; this.compose(); });
  }

  compose() {
    const { large } = known.picture || {};
    if (!large || !this.canvas.isConnected) return;
    const ratio = window.devicePixelRatio || 1, room = this.dialog ? window.innerHeight - 90 : Infinity;
    this.w = Math.max(80, this.canvas.clientWidth);
    this.h = Math.min(room, Math.max(this.w * large.height / large.width, 60));
    if (this.dialog) this.h = room;
    const width = Math.round(this.w * ratio), height = Math.round(this.h * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width; this.canvas.height = height; this.canvas.style.height = `${this.h}px`;
    }
    const g = this.canvas.getContext('2d', flat), k = this.base() * this.zoom * ratio;
    g.setTransform(1, 0, 0, 1, 0, 0); g.fillStyle = '#181b1f'; g.fillRect(0, 0, width, height);
    g.imageSmoothingEnabled = k < 3;
    g.setTransform(k, 0, 0, k, width / 2 - this.at[0] * large.width * k, height / 2 - this.at[1] * large.height * k);
    g.drawImage(large, 0, 0);
    this.canvas.dataset.zoom = this.zoom.toFixed(2); this.canvas.dataset.frame = known.picture.head.frame;
    this.canvas.dataset.size = known.picture.head.size.join('x');
  }
}
customElements.define('stereocalib-picture', Picture);
