// The line to the server: one WebSocket a browser. Messages are a JSON head with bytes behind it.
export const bus = new EventTarget();
export const known = { now: null, page: null, picture: null, signals: null, camera: null, me: null, docking: null };
// Where the processor stands in for a graphics card, canvases in memory are several times as quick.
export const flat = window.drawnByProcessor() ? { willReadFrequently: true } : undefined;
const decoder = new TextDecoder();
let socket = null, wait = 300, wanted = null;

// What is asked while the line is down is asked when it is up again; of each kind the latest.
const unsent = new Map();
export function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  else if (message.t !== 'hello' && message.t !== 'shown') unsent.set(message.t, message);
}
function catchUp() {
  const waiting = [...unsent.values()];
  unsent.clear();
  waiting.forEach(send);
}

export function tell(name, detail) { bus.dispatchEvent(new CustomEvent(name, { detail })); }

export function listen(name, action) {
  const heard = event => action(event.detail);
  bus.addEventListener(name, heard);
  return () => bus.removeEventListener(name, heard);
}

// What the address said when the page was opened; told to the server once it knows who we are.
export function want(state) { wanted = state; }

function hello() {
  if (!known.me && !known.anonymous) return;
  send({ t: 'hello', ...(known.me || {}), state: wanted, docking: known.docking });
  if (known.me) wanted = null;
}

class Me extends HTMLElement {
  connectedCallback() {
    const me = { client: Number(this.dataset.client), key: this.dataset.key };
    if (known.me && known.me.key === me.key) return;
    known.me = me;
    hello();
  }
}
customElements.define('stereocalib-me', Me);

async function received(buffer) {
  const size = new DataView(buffer).getUint32(0);
  const head = JSON.parse(decoder.decode(new Uint8Array(buffer, 4, size)));
  const body = buffer.slice(4 + size);
  if (head.t === 'now') {
    try {
      known.now = head;
      if (head.picture) {
        const p = head.picture, jpeg = { type: 'image/jpeg' };
        const [large, sheet] = await Promise.all([
          createImageBitmap(new Blob([body.slice(0, p.bytes)], jpeg)),
          createImageBitmap(new Blob([body.slice(p.bytes, p.bytes + p.sheet)], jpeg)),
        ]);
        known.picture?.large.close(); known.picture?.sheet.close();
        known.picture = { head: p, large, sheet };
        tell('picture', known.picture);
      }
      tell('now', head);
    } finally { send({ t: 'shown' }); }
    return;
  }
  if (head.t === 'page') known.page = head;
  if (head.t === 'camera') known.camera = head.camera;
  if (head.t === 'signals') known.signals = { head, body };
  tell(head.t, { head, body });
}

function connect() {
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  socket = new WebSocket(`${scheme}://${location.host}/own/link`);
  socket.binaryType = 'arraybuffer';
  let last = Promise.resolve();
  socket.onopen = () => { wait = 300; hello(); catchUp(); };
  socket.onmessage = event => { last = last.then(() => received(event.data)).catch(console.warn); };
  socket.onclose = () => { setTimeout(connect, wait); wait = Math.min(2 * wait, 5000); };
}
connect();
// Where viser's panel is folded away our name is not in the page: be a guest then.
setTimeout(() => { if (!known.me) { known.anonymous = true; hello(); } }, 6000);
