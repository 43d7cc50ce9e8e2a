// A WebXR that is not there: its frames are those of `window.fakeFrames`, as Chrome on a phone would hand them out.
"use strict";
window.fakeXR = { at: 0, asked: null, ended: false, states: [] };
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

class FakeSession extends EventTarget {
  requestAnimationFrame(draw) {
    setTimeout(() => {
      if (fakeXR.ended) return;
      const one = window.fakeFrames[fakeXR.at % window.fakeFrames.length];
      const view = {
        camera: one.picture ? { width: one.width, height: one.height, picture: one.picture } : undefined,
        projectionMatrix: Float32Array.from(one.projection),
        transform: { position: one.position, orientation: one.orientation },
      };
      const depth = {
        width: one.depthWidth, height: one.depthHeight, rawValueToMeters: one.unit, data: bytes(one.depth).buffer,
        normDepthBufferFromNormView: { matrix: Float32Array.from(one.depthFromView) },
      };
      // In turn: nothing known, a guessed pose, no depth, and then all of it; a real phone begins like that.
      const stage = fakeXR.calls = (fakeXR.calls || 0) + 1;
      const frame = {
        getViewerPose: () => stage === 1 ? null : { emulatedPosition: stage === 2, views: [view] },
        getDepthInformation: () => stage === 3 ? null : depth,
      };
      if (stage > 3) fakeXR.at++;
      draw(performance.now(), frame);
    }, 70);
  }
  updateRenderState(state) { fakeXR.states.push(Object.keys(state)); }
  async requestReferenceSpace(kind) { return kind; }
  async end() { fakeXR.ended = true; this.dispatchEvent(new Event("end")); }
}

window.XRWebGLLayer = class {
  getViewport() { const one = window.fakeFrames[0]; return { width: one.width, height: one.height }; }
};
window.XRWebGLBinding = class {
  constructor(session, gl) { this.gl = gl; }
  getCameraImage(camera) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    // Rows from the bottom, as textures have them.
    const top = bytes(camera.picture), row = 4 * camera.width, all = new Uint8Array(top.length);
    for (let y = 0; y < camera.height; y++) all.set(top.subarray(y * row, (y + 1) * row), (camera.height - 1 - y) * row);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, camera.width, camera.height, 0, gl.RGBA, gl.UNSIGNED_BYTE, all);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    return texture;
  }
};
Object.defineProperty(navigator, "xr", { value: {
  isSessionSupported: async (mode) => mode === "immersive-ar" && !window.fakeXR.none,
  requestSession: async (mode, options) => { fakeXR.asked = [mode, options.depthSensing]; return new FakeSession(); },
} });
