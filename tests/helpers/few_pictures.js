// Without a graphics card drawing takes more than all else: pages draw with rests between, and no edges smoothed.
"use strict";
{
  const REST_MS = 30;
  const wait = window.setTimeout.bind(window), forget = window.clearTimeout.bind(window);
  const draw = window.requestAnimationFrame.bind(window), leave = window.cancelAnimationFrame.bind(window);
  const asked = new Map();
  window.requestAnimationFrame = (call) => {
    const number = wait(() => {
      asked.set(number, draw((time) => {
        asked.delete(number);
        call(time);
      }));
    }, REST_MS);
    return number;
  };
  window.cancelAnimationFrame = (number) => {
    forget(number);
    leave(asked.get(number));
    asked.delete(number);
  };
  const context = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return context.call(this, kind, kind.startsWith("webgl") ? { ...options, antialias: false } : options);
  };
}
