// Runs before viser's own script.
// viser makes the address of its WebSocket from the page's, which must not hold a fragment.
window.stereocalibOpened = location.hash;
history.replaceState(null, '', location.pathname + location.search);

// viser begins to load a map of surroundings, and shows little until it is there, before it is told that there is none.
{
  const all = window.fetch;
  window.fetch = (what, ...more) => String(what?.url ?? what).startsWith('data:image/jpeg') ? new Promise(() => {}) : all(what, ...more);
}

// Where the processor stands in for a graphics card, smooth edges of the 3-D view are a quarter of all drawing.
{
  const get = HTMLCanvasElement.prototype.getContext;
  let slow = null;
  window.drawnByProcessor = () => {
    if (slow === null) {
      const gl = get.call(document.createElement('canvas'), 'webgl2'), told = gl && gl.getExtension('WEBGL_debug_renderer_info');
      slow = !told || /swiftshader|llvmpipe|software|basic render/i.test(String(gl.getParameter(told.UNMASKED_RENDERER_WEBGL)));
    }
    return slow;
  };
  HTMLCanvasElement.prototype.getContext = function (kind, how, ...more) {
    return get.call(this, kind, kind === 'webgl2' && how?.antialias && window.drawnByProcessor() ? { ...how, antialias: false } : how, ...more);
  };
}
