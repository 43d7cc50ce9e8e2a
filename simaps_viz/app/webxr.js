"use strict";
// Sends what the phone sees to `simaps live`. The layout of messages is in webxr.py.
const EVERY_MS = 60, MAX_SIDE = 640, MAX_WAITING_BYTES = 1 << 20, HEAD_BYTES = 68, TAKEN_OVER = 4000;
const NEAR_M = 0.001;  // whether depths count from the camera or from the near plane then makes no difference
const status = document.getElementById("status"), toggle = document.getElementById("toggle");
let socket = null, session = null, encoding = false, sent = 0, skipped = 0, lastMs = 0;

function say(text) { status.textContent = text; }

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss:" : "ws:"}//${location.host}/frames`);
  socket.onclose = (event) => {
    if (!session) return;
    if (event.code === TAKEN_OVER) { end("Another phone has taken over."); return; }
    say("Connection lost, trying again …");
    setTimeout(() => { if (session) connect(); }, 1000);
  };
}

function end(why) {
  const was = session;
  session = null;
  socket?.close();
  toggle.textContent = "Start";
  say(why);
  was?.end().catch(() => { /* it has ended by itself */ });
}

// Depth as the view shows it, upright: the sensor's rows may run along the view's columns.
function depthOfView(info, aspect) {
  const m = info.normDepthBufferFromNormView.matrix, raw = new Uint16Array(info.data);
  const long = Math.max(info.width, info.height);
  const width = Math.max(Math.round(long * Math.min(aspect, 1)), 1);
  const height = Math.max(Math.round(long / Math.max(aspect, 1)), 1);
  const depth = new Uint16Array(width * height);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      const x = (column + 0.5) / width, y = (row + 0.5) / height;
      const u = Math.floor((m[0] * x + m[4] * y + m[12]) * info.width);
      const v = Math.floor((m[1] * x + m[5] * y + m[13]) * info.height);
      if (u >= 0 && v >= 0 && u < info.width && v < info.height) depth[row * width + column] = raw[v * info.width + u];
    }
  }
  return { width, height, depth };
}

// The camera's picture, rows from the top, as it has to be read while the frame lasts.
function pixelsOf(gl, binding, camera, target) {
  const share = Math.min(MAX_SIDE / Math.max(camera.width, camera.height), 1);
  const width = Math.round(camera.width * share), height = Math.round(camera.height * share);
  const picture = new ImageData(width, height);
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.source);
  gl.framebufferTexture2D(gl.READ_FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, binding.getCameraImage(camera), 0);
  gl.bindRenderbuffer(gl.RENDERBUFFER, target.buffer);
  gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, width, height);
  gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, target.small);
  gl.framebufferRenderbuffer(gl.DRAW_FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, target.buffer);
  gl.blitFramebuffer(0, 0, camera.width, camera.height, 0, height, width, 0, gl.COLOR_BUFFER_BIT, gl.LINEAR);
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.small);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(picture.data.buffer));
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return picture;
}

async function encoded(picture) {
  const canvas = new OffscreenCanvas(picture.width, picture.height);
  canvas.getContext("2d").putImageData(picture, 0, 0);
  return await canvas.convertToBlob({ type: "image/jpeg", quality: 0.9 });
}

// All but the size of the picture, which is known once it is encoded; the view is gone by then.
function headOf({ width, height }, ms, unitM, view) {
  const head = new DataView(new ArrayBuffer(HEAD_BYTES)), p = view.projectionMatrix;
  const { position, orientation } = view.transform;
  new Uint8Array(head.buffer).set(new TextEncoder().encode("SMX1"));
  head.setUint16(4, width, true);
  head.setUint16(6, height, true);
  head.setFloat64(12, ms, true);
  const camera = [p[0] * width / 2, p[5] * height / 2, (1 - p[8]) * width / 2 - 0.5, (1 + p[9]) * height / 2 - 0.5];
  const pose = [position.x, position.y, position.z, orientation.x, orientation.y, orientation.z, orientation.w];
  [unitM, ...camera, ...pose].forEach((number, i) => head.setFloat32(20 + 4 * i, number, true));
  return head;
}

async function send(head, depth, picture) {
  encoding = true;
  try {
    const blob = picture ? await encoded(picture) : new Blob([]);
    head.setUint32(8, blob.size, true);
    const message = new Blob([head, depth.depth, blob]);
    if (socket.readyState === WebSocket.OPEN) { socket.send(message); sent++; }
  } finally { encoding = false; }
}

async function start() {
  const gl = document.createElement("canvas").getContext("webgl2", { xrCompatible: true });
  session = await navigator.xr.requestSession("immersive-ar", {
    requiredFeatures: ["depth-sensing"], optionalFeatures: ["camera-access", "dom-overlay"],
    domOverlay: { root: document.body },
    depthSensing: {
      usagePreference: ["cpu-optimized"], dataFormatPreference: ["luminance-alpha"], depthTypeRequest: ["raw", "smooth"],
    },
  });
  session.addEventListener("end", () => { if (session) end("Ended."); });
  const layer = new XRWebGLLayer(session, gl), binding = new XRWebGLBinding(session, gl);
  const target = { source: gl.createFramebuffer(), small: gl.createFramebuffer(), buffer: gl.createRenderbuffer() };
  session.updateRenderState({ baseLayer: layer, depthNear: NEAR_M });
  const space = await session.requestReferenceSpace("local");
  toggle.textContent = "End";
  connect();

  const onFrame = (t, frame) => {
    if (!session) return;
    session.requestAnimationFrame(onFrame);
    if (t - lastMs < EVERY_MS || encoding || socket.readyState !== WebSocket.OPEN) return;
    if (socket.bufferedAmount > MAX_WAITING_BYTES) { skipped++; return; }
    const pose = frame.getViewerPose(space), view = pose?.views[0];
    if (!view || pose.emulatedPosition) { say("Looking for where the phone is …"); return; }
    const info = frame.getDepthInformation(view);
    if (!info) { say("No depth yet: move the phone a little."); return; }
    lastMs = t;
    const port = layer.getViewport(view);
    const picture = view.camera ? pixelsOf(gl, binding, view.camera, target) : null;
    const depth = depthOfView(info, port.width / port.height);
    const head = headOf(depth, performance.timeOrigin + t, info.rawValueToMeters, view);
    send(head, depth, picture).catch((error) => end(String(error)));
    say(`${sent} frames sent${picture ? "" : " without pictures"}${skipped ? `, ${skipped} left out` : ""}`);
  };
  session.requestAnimationFrame(onFrame);
}

toggle.onclick = async () => {
  if (session) { end("Ended."); return; }
  const able = isSecureContext && await navigator.xr?.isSessionSupported("immersive-ar").catch(() => false);
  if (!able) { say("This browser has no AR: use Chrome on an Android phone with ARCore, at http://localhost."); return; }
  try { await start(); } catch (error) { end(`No AR session with depth: ${error.message}`); }
};
