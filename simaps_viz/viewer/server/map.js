(() => {  // the map itself: names and outlines under the pointer, and hands as on every map
  if (window.simapsMap) return;
  window.simapsMap = {};
  const SVG = 'http://www.w3.org/2000/svg';
  const TOP = 'Top view';
  const make = (tag, name, parent) => {
    const one = document.createElement(tag);
    one.className = name;
    return parent ? parent.appendChild(one) : one;
  };
  const over = make('div', 'simaps-over');
  const coming = make('div', 'simaps-coming', over);
  coming.textContent = 'Loading the map …';
  const drawing = make('canvas', 'simaps-drawing', over);
  const names = make('div', 'simaps-names', over);
  const hint = make('div', 'simaps-hint', over);
  hint.setAttribute('role', 'status');
  const north = make('button', 'simaps-north', over);
  north.type = 'button';
  north.title = 'North up, and the whole map';
  north.setAttribute('aria-label', 'North up');
  const compass = north.appendChild(document.createElementNS(SVG, 'svg'));
  compass.setAttribute('viewBox', '-12 -12 24 24');
  for (const [d, name] of [['M0 -10 L4.5 2 L0 0 Z M0 -10 L-4.5 2 L0 0 Z', 'simaps-needle'], ['M-2.6 10 V4 L2.6 10 V4', 'simaps-n']]) {
    const path = compass.appendChild(document.createElementNS(SVG, 'path'));
    path.setAttribute('d', d);
    path.setAttribute('class', name);
  }
  for (const kind of ['pointerdown', 'pointerup', 'pointermove', 'wheel'])
    north.addEventListener(kind, (event) => event.stopPropagation());

  const chip = make('div', 'simaps-shown', over);  // which of the two is shown, before a slider was moved or after
  const alone = make('button', 'simaps-shown simaps-alone', over);  // which class is shown alone, and a way back
  alone.type = 'button';
  alone.hidden = true;
  alone.addEventListener('click', () => tell({ type: 'class', name: state.only, do: 'only' }));
  const about = make('button', 'simaps-shown simaps-about', over);  // what is selected, while the tab about it is not open
  about.type = 'button';
  about.title = 'More about it, and why it is one object';
  about.hidden = true;
  for (const one of [alone, about]) for (const kind of ['pointerdown', 'pointerup', 'pointermove']) one.addEventListener(kind, (event) => event.stopPropagation());
  about.addEventListener('click', () => tell({ type: 'about' }));
  const scale = make('div', 'simaps-scale', over);
  scale.setAttribute('role', 'img');

  // At every frame; what is set to the value that it has would be laid out and drawn anew all the same.
  const give = (owner, name, value) => { if (owner[name] !== value) owner[name] = value; };

  // What a person does here is told to the page's session, one message after the other.
  let telling = Promise.resolve();
  const tell = (event) => {
    const frame = document.querySelector('iframe[title=Tab]');
    if (!frame) return;
    const address = '/tab/event' + new window.URL(frame.src).search;
    const sent = { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(event) };
    telling = telling.then(() => window.fetch(address, sent)).catch(() => {});
  };
  north.addEventListener('click', () => tell({ type: 'north' }));

  // The objects of the map, and the texts on it, as the page was sent them.
  let sent = null, map = null, stateSent = null, state = { view: TOP, selected: null };
  let textsSent = null, allTexts = [], texts = [];  // all, and those of what is shown: the map, or a picture over it
  const readTexts = () => {
    const one = document.querySelector('.simaps-texts');
    if (one === textsSent) return false;
    textsSent = one;
    allTexts = one ? JSON.parse(one.dataset.texts) : [];
    return true;
  };
  const readState = () => {
    const one = document.querySelector('.simaps-state');
    if (one === stateSent) return false;
    stateSent = one;
    if (one) state = JSON.parse(one.dataset.state);
    return true;
  };
  const GROUND_ID = 1 << 23;  // ids from there on are of what is there where no object is
  const readObjects = () => {
    const one = document.querySelector('.simaps-objects');
    if (one === sent) return;
    sent = one;
    if (!one) { map = null; changed = true; return; }
    const told = JSON.parse(one.dataset.objects), picture = one.querySelector('img');
    picture.decode().then(() => {
      if (one !== sent) return;
      map = read(told, picture);
      count = 0;  // where names of the map before stood counts for nothing
      changed = 2;  // drawn twice: what is under the pointer may be a name, which the first picture places
    }).catch(() => {});
  };
  const read = (told, picture) => {
    const cols = picture.naturalWidth, rows = picture.naturalHeight;
    const plane = make('canvas', '');
    plane.width = cols;
    plane.height = rows;
    const context = plane.getContext('2d', { willReadFrequently: true });
    context.drawImage(picture, 0, 0);
    const pixels = context.getImageData(0, 0, cols, rows).data, ids = new Uint32Array(rows * cols), ground = new Uint16Array(rows * cols);
    const objects = new Map(told.objects.map(([id, name, label, facts]) => [id, {
      id, name, label, facts, west: cols, east: -1, south: rows, north: -1, cells: 0, x: 0, y: 0 }]));
    for (let i = 0; i < ids.length; i++) {
      const id = pixels[4 * i] + 256 * pixels[4 * i + 1] + 65536 * pixels[4 * i + 2];
      if (id >= GROUND_ID) ground[i] = id - GROUND_ID; else ids[i] = id;
    }
    for (let row = 0, i = 0; row < rows; row++) for (let col = 0; col < cols;) {  // cells of one object in a row at once
      const id = ids[i], from = col;
      do { col++; i++; } while (col < cols && ids[i] === id);
      const one = id ? objects.get(id) : undefined;
      if (!one) continue;
      one.west = Math.min(one.west, from); one.east = Math.max(one.east, col);
      one.south = Math.min(one.south, row); one.north = Math.max(one.north, row + 1);
      one.cells += col - from; one.x += (col - from) * (from + col) / 2; one.y += (col - from) * (row + 0.5);
    }
    const [xmin, ymin] = told.extent;
    const shown = [...objects.values()].filter((one) => one.cells);
    for (const one of shown) { one.x /= one.cells; one.y /= one.cells; settle(one, ids, cols); }
    return { ids, rows, cols, cell: told.cell, xmin, ymin, objects, shown, number: told.map, groundAt: (col, row) =>
      (col >= 0 && row >= 0 && col < cols && row < rows ? told.ground[ground[row * cols + col]] : '') };
  };
  const settle = (one, ids, cols) => {  // a name stands on its object: at the cell nearest to the middle
    if (ids[Math.floor(one.y) * cols + Math.floor(one.x)] === one.id) return;
    let best = Infinity, at = [one.x, one.y];
    for (let row = one.south; row < one.north; row++) for (let col = one.west; col < one.east; col++) {
      if (ids[row * cols + col] !== one.id) continue;
      const away = (col + 0.5 - one.x) ** 2 + (row + 0.5 - one.y) ** 2;
      if (away < best) { best = away; at = [col + 0.5, row + 0.5]; }
    }
    [one.x, one.y] = at;
  };
  const outlineOf = (one) => {  // along the edges of its cells
    if (one.outline) return one.outline;
    const path = one.outline = new window.Path2D(), { ids, rows, cols } = map;
    const is = (row, col) => row >= 0 && col >= 0 && row < rows && col < cols && ids[row * cols + col] === one.id;
    for (let row = one.south; row < one.north; row++) for (let col = one.west; col < one.east; col++) {
      if (!is(row, col)) continue;
      if (!is(row - 1, col)) { path.moveTo(col, row); path.lineTo(col + 1, row); }
      if (!is(row + 1, col)) { path.moveTo(col, row + 1); path.lineTo(col + 1, row + 1); }
      if (!is(row, col - 1)) { path.moveTo(col, row); path.lineTo(col, row + 1); }
      if (!is(row, col + 1)) { path.moveTo(col + 1, row); path.lineTo(col + 1, row + 1); }
    }
    return path;
  };

  // Where a point of the floor, or above it, appears on the canvas, and back.
  let toScreen = null, all = null, width = 0, height = 0;
  const look = (viser, canvas) => {
    const node = viser.nodeRefFromName['/map'], camera = viser.camera;
    if (!state.middle || !node || !camera) return null;
    all = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).multiply(node.matrixWorld).elements;
    const row = (i) => [all[i], all[4 + i], all[12 + i]];
    const [u, v, w] = [row(0), row(1), row(3)];
    width = canvas.clientWidth; height = canvas.clientHeight;
    return [u.map((one, i) => (one + w[i]) * width / 2), v.map((one, i) => (w[i] - one) * height / 2), w];
  };
  const at = ([u, v, w], x, y) => {
    const far = w[0] * x + w[1] * y + w[2];
    return [(u[0] * x + u[1] * y + u[2]) / far, (v[0] * x + v[1] * y + v[2]) / far];
  };
  const seenAt = (x, y, z) => {  // metres of the map to pixels; null behind the camera
    const [a, b] = [x - state.middle[0], y - state.middle[1]];
    const [u, v, , w] = [0, 1, 2, 3].map((i) => all[i] * a + all[4 + i] * b + all[8 + i] * z + all[12 + i]);
    return w > 0 ? [(u / w + 1) * width / 2, (1 - v / w) * height / 2] : null;
  };
  const cellToMap = (col, row) => [map.xmin + col * map.cell - state.middle[0], map.ymin + row * map.cell - state.middle[1]];
  const floorAt = ([[a, b, c], [d, e, f], [g, h, i]], px, py) => {  // two lines of the floor meet under the pixel
    const [p, q, r] = [a - px * g, b - px * h, c - px * i], [s, t, m] = [d - py * g, e - py * h, f - py * i];
    const det = p * t - q * s;
    return [(q * m - r * t) / det + state.middle[0], (r * s - p * m) / det + state.middle[1]];
  };
  const cellAt = (...pixel) => {
    const [x, y] = floorAt(...pixel);
    return [Math.floor((x - map.xmin) / map.cell), Math.floor((y - map.ymin) / map.cell)];
  };

  const GAP = 3, LINE = 16, CLICK_PX = 3, PHONE_PX = 600, LEADER_PX = 12;
  const measure = make('canvas', '').getContext('2d');
  const widths = new Map();
  const widthOf = (text) => {
    if (!widths.has(text)) {
      measure.font = '600 12px system-ui, sans-serif';
      widths.set(text, measure.measureText(text).width + 2);
    }
    return widths.get(text);
  };
  const spans = [], written = [];
  let count = 0, leaders = [];  // lines from texts to what they are of, in pixels
  const named = (x, y) => {  // the id of the object whose name is there
    const found = written.slice(0, count).find(([box, id]) => id && covers(box, [x, y, x, y]));
    return found ? found[1] : 0;
  };
  const place = (text, box, id, kind) => {
    const [x, y] = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    const span = spans[count] || (spans[count] = make('span', '', names));
    written[count++] = [box, id];
    if (span.textContent !== text) span.textContent = text;
    span.className = kind;
    span.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
    span.hidden = false;
  };
  const covers = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
  const isFree = (box, others) => !others.some((other) => covers(box, other));
  const isWhole = (box) => box[0] >= 0 && box[1] >= 0 && box[2] <= width && box[3] <= height;
  const SIDES = [[0, -1], [1, 0], [-1, 0], [0, 1], [1, -1], [-1, -1], [1, 1], [-1, 1]];
  const AT = [0, -1, 1, -2, 2, -3, 3];
  const liesOn = (box, own) => {  // whether a text lies on another object than its own, which would seem to be called so
    const [left, top, right, bottom] = box, steps = [0, 0.25, 0.5, 0.75, 1];
    return steps.some((i) => [top, bottom].some((y) => {
      const [col, row] = cellAt(toScreen, left + i * (right - left), y);
      const id = col >= 0 && row >= 0 && col < map.cols && row < map.rows ? map.ids[row * map.cols + col] : 0;
      return id && id !== own;
    }));
  };
  // What the page was sent: beside what it names, not over it, and whole where there is room; the first is always there.
  const writeTexts = (taken, under) => {
    const flat = state.view === TOP, things = [], said = [], isMeant = texts.some(([kind]) => kind === 'command');
    for (const [kind, text, x, y, reachX, reachY, awayX, awayY, z, reachZ, id] of texts) {
      const corners = [];
      for (const i of [-1, 1]) for (const j of [-1, 1]) for (const k of flat ? [0] : [-1, 1])
        corners.push(seenAt(x + i * reachX, y + j * reachY, flat ? 0 : z + k * reachZ));
      if (corners.includes(null)) continue;
      const [xs, ys] = [0, 1].map((i) => corners.map((one) => one[i]));
      const thing = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
      if (reachX || reachY) things.push(thing);
      if (!text || (kind === 'selection' && under && under.id === state.selected) || (kind === 'why' && isMeant)) continue;
      const away = awayX || awayY ? seenAt(x + awayX, y + awayY, flat ? 0 : z) : null;
      said.push({ kind, text, id, thing, away, isPoint: !reachX && !reachY && !away });
    }
    let part = 0;  // of a change, outlined in the colour of its name
    for (const { kind, text, id, thing, away, isPoint } of said) {
      const [x, y] = [(thing[0] + thing[2]) / 2, (thing[1] + thing[3]) / 2], half = widthOf(text) / 2 + 7, high = LINE / 2 + 1;
      const [outX, outY] = [(thing[2] - thing[0]) / 2 + GAP + half, (thing[3] - thing[1]) / 2 + GAP + high];
      const rank = ([i, j]) => (away ? i * (away[0] - x) + j * (away[1] - y) : 0);
      const sides = [...SIDES].sort((a, b) => Math.hypot(...a) - Math.hypot(...b) || rank(b) - rank(a));
      const middles = isPoint ? AT.map((k) => [x, y + k * 2 * high])
        : [0, 1, 2].flatMap((ring) => sides.map(([i, j]) => [x + i * outX, y + j * (outY + ring * 2 * high)]));
      const boxes = middles.map(([a, b]) => [a - half, b - high, a + half, b + high]);
      const apart = boxes.filter((box) => isFree(box, taken)), free = apart.filter((box) => isFree(box, things));
      const box = [...free, ...apart].find(isWhole) || free[0] || apart[0] || (taken.length ? null : boxes[0]);
      if (kind === 'change') part++;
      if (!box) continue;
      taken.push(box);
      const look = { selection: 'simaps-chosen', rooms: 'simaps-room', change: `simaps-other simaps-part-${(part - 1) % 3 + 1}` }[kind]
        || (text.startsWith('▶') ? 'simaps-meant' : 'simaps-other');
      place(text, box, kind === 'selection' ? 0 : id, `simaps-text ${look}`);  // a press on it means what it lies on
      const one = flat && map && kind !== 'selection' && map.objects.get(id);
      if (!one || !one.cells) continue;
      const to = at(toScreen, ...cellToMap(one.x, one.y)), from = [0, 1].map((i) => Math.min(Math.max(to[i], box[i]), box[i + 2]));
      const reach = Math.min(thing[2] - thing[0], thing[3] - thing[1]) / 2;  // about as far as its cells go
      if (Math.hypot(to[0] - from[0], to[1] - from[1]) > LEADER_PX + reach || liesOn(box, id)) leaders.push([from, to]);
    }
  };
  // Large objects first; a name is left out where it would cover another or the middle of a larger object, which would
  // seem to be called so, or be far larger than its own. It moves up or down, still on its object, where that helps, and
  // then keeps off the inner half of larger ones.
  const writeNames = (taken, look) => {
    const [left, top] = at(toScreen, 0, 0), [right, bottom] = at(toScreen, map.cell, map.cell);
    const px = Math.hypot(right - left, bottom - top) / Math.SQRT2, texted = new Set(texts.map((one) => one[1] && one[10]));
    const dense = width < PHONE_PX ? 2 : 1;  // names of one size are larger beside what a small map shows
    const shown = map.shown.filter((one) => shows(one.label));
    const middles = shown.map((one) => at(toScreen, ...cellToMap(one.x, one.y))).map(([x, y]) => [x, y, x, y]);
    const inner = shown.map(({ east, west, north, south }, i) => {
      const [x, y] = middles[i], [reachX, reachY] = [(east - west) * px / 4, (north - south) * px / 4];
      return [x - reachX, y - reachY, x + reachX, y + reachY];
    });
    const most = state.only ? 4 : 2.2;  // widths of its own: of one class alone most names fit
    for (const [i, one] of shown.entries()) {
      if (one.id === state.selected || texted.has(one.id)) continue;
      const wide = (one.east - one.west) * px, high = (one.north - one.south) * px;
      if (high * dense < 13 || wide * dense < 13) continue;
      if (widthOf(one.name) > most * dense * Math.max(wide, Math.sqrt(wide * high))) continue;
      const half = widthOf(one.name) / 2 + GAP, [x, middle] = middles[i], away = (high + LINE) / 4;
      for (const y of [middle, middle - away, middle + away]) {
        const box = [x - half, y - LINE / 2, x + half, y + LINE / 2];
        if (!isWhole(box) || !isFree(box, taken) || !isFree(box, (y === middle ? middles : inner).slice(0, i))) continue;
        taken.push(box);
        place(one.name, box, one.id, look);
        break;
      }
    }
  };

  // The line between two maps that are compared is dragged by its handle.
  const handle = make('div', 'simaps-divider', over);
  handle.title = 'Drag: how much of the floor shows the left map';
  let divide = null, divideSent = null, dragged = null, held = false, sending = 0;
  const readDivide = () => {
    const one = document.querySelector('.simaps-divide');
    if (one === divideSent) return false;
    divideSent = one;
    divide = one && JSON.parse(one.dataset.divide);
    if (!held && !sending) dragged = null;  // what was dragged last is still to be sent
    return true;
  };
  const placeHandle = () => {
    give(handle, 'hidden', !divide || !toScreen);
    if (handle.hidden) return;
    const [west, south, east, north] = divide.extent, x = west + (dragged ?? divide.share) / 100 * (east - west) - state.middle[0];
    const [[left, low], [, high]] = [south, north].map((y) => at(toScreen, x, y - state.middle[1]));
    const middle = (Math.max(high, 60) + Math.min(low, height - 60)) / 2;
    handle.style.transform = `translate(${left.toFixed(1)}px, ${middle.toFixed(1)}px) translate(-50%, -50%)`;
  };
  for (const kind of ['pointerdown', 'pointerup', 'pointermove', 'pointercancel', 'wheel'])
    handle.addEventListener(kind, (event) => {
      event.stopPropagation();
      if (kind === 'pointerdown') { held = true; handle.setPointerCapture(event.pointerId); }
      if (kind === 'pointerup' || kind === 'pointercancel') held = false;
      if (kind !== 'pointermove' || !held || !divide || !toScreen) return;
      const box = over.getBoundingClientRect(), [west, , east] = divide.extent;
      const [x] = floorAt(toScreen, event.clientX - box.left, event.clientY - box.top);
      dragged = Math.min(Math.max(100 * (x - west) / (east - west), 0), 100);
      changed = true;
      if (!sending) sending = setTimeout(() => { sending = 0; tell({ type: 'divide', share: dragged }); }, 60);
    });

  // The scale bar: the longest round length that is short enough, at the middle of the map's view.
  const MOST_PX = 110;
  const drawScale = () => {
    const metre = Math.hypot(...[0, 1].map((i) => at(toScreen, 1, 0)[i] - at(toScreen, 0, 0)[i]));
    const power = 10 ** Math.floor(Math.log10(MOST_PX / metre)), long = [5, 2, 1].find((one) => one * power * metre <= MOST_PX) * power;
    const text = long < 1 ? `${Math.round(100 * long)} cm` : `${Math.round(long)} m`;
    if (scale.textContent !== text) { scale.textContent = text; scale.setAttribute('aria-label', `Scale: ${text}`); }
    scale.style.width = `${(long * metre).toFixed(1)}px`;
  };

  // The object under the pointer, and the class that the legend points to.
  let pointer = null, pressed = false, pointed = null, chosen = null;
  const inCanvas = (event) => event.target.closest && event.target.closest('.simaps-over') === null
    && over.parentElement && over.parentElement.contains(event.target);
  window.addEventListener('pointermove', (event) => {
    pointer = event.pointerType !== 'touch' && inCanvas(event) ? [event.clientX, event.clientY] : null;
    pressed = event.buttons !== 0;
    changed = true;
  }, true);
  document.documentElement.addEventListener('pointerleave', () => { pointer = null; changed = true; });
  const factsOf = (one) => one.facts + (state.doubtful && state.doubtful[one.id] ? ` · ${state.doubtful[one.id]}` : '');
  const say = (said, x, y) => {  // beside the pointer
    give(hint, 'hidden', !said);
    if (!said) return;
    const wide = widthOf(said) + 14;
    if (hint.textContent !== said) hint.textContent = said;
    hint.style.transform = `translate(${Math.min(x + 14, width - wide - 4)}px, ${y > 44 ? y - 34 : y + 22}px)`;
  };
  // In 3-D the page is asked what a click would take, once the pointer rests; the answer holds until it moves.
  const REST_MS = 120;
  let rest = 0, restSince = 0, restAt = '', underSent = null, underRay = {};
  const readUnder = () => {
    const one = document.querySelector('.simaps-under');
    if (one === underSent) return;
    underSent = one;
    underRay = one ? JSON.parse(one.dataset.under) : {};
  };
  const sayInSpace = (viser, canvas, view) => {
    const now = pointer && !pressed ? `${pointer}|${view}` : '';
    if (now !== restAt) { restAt = now; restSince = Date.now(); rest = -Math.abs(rest) - 1; }
    const box = canvas.getBoundingClientRect(), [x, y] = now ? [pointer[0] - box.left, pointer[1] - box.top] : [0, 0];
    if (now && rest < 0 && Date.now() - restSince > REST_MS) {
      rest = -rest;
      const back = viser.camera.projectionMatrix.clone().multiply(viser.camera.matrixWorldInverse).multiply(viser.nodeRefFromName['/map'].matrixWorld).invert().elements;
      const end = (z) => {
        const [a, b] = [2 * x / width - 1, 1 - 2 * y / height], [p, q, r, w] = [0, 1, 2, 3].map((i) => back[i] * a + back[4 + i] * b + back[8 + i] * z + back[12 + i]);
        return [p / w + state.middle[0], q / w + state.middle[1], r / w];
      };
      const [from, to] = [end(-1), end(1)];
      tell({ type: 'under', number: rest, ray: [...from, ...to.map((one, i) => one - from[i])] });
    }
    say(now && rest > 0 && underRay.number === rest ? factsOf(underRay) : '', x, y);
  };
  let drawn = false;
  const draw = (context, one, thin) => {
    drawn = true;
    const path = outlineOf(one);
    const corner = at(toScreen, ...cellToMap(0, 0)), east = at(toScreen, ...cellToMap(1, 0)), up = at(toScreen, ...cellToMap(0, 1));
    const scale = window.devicePixelRatio || 1, px = Math.hypot(east[0] - corner[0], east[1] - corner[1]);
    context.save();
    context.scale(scale, scale);
    context.transform(east[0] - corner[0], east[1] - corner[1], up[0] - corner[0], up[1] - corner[1], ...corner);
    context.lineCap = 'square';
    rim(context, path, thin ? 1.5 : 2, px);
    context.restore();
  };
  const rim = (context, path, wide, px) => {  // dark on a light page, light on a dark one, and rimmed
    const dark = document.documentElement.dataset.mantineColorScheme === 'dark';
    for (const [line, color] of [[wide > 1.5 ? 2.25 * wide : 2 * wide, dark ? '#101114' : '#fff'], [wide, dark ? '#fff' : '#0f121a']]) {
      context.lineWidth = line / px;
      context.strokeStyle = color;
      context.stroke(path);
    }
  };
  const lead = (context) => {
    drawn = true;
    const path = new window.Path2D(), scale = window.devicePixelRatio || 1;
    for (const [from, to] of leaders) { path.moveTo(...from); path.lineTo(...to); }
    context.save();
    context.scale(scale, scale);
    rim(context, path, 1, 1);
    context.restore();
  };
  const ROBOT = 'The robot: commands start here, it looks along the arrow', ROBOT_PX = 14, LEAST_PX = 8, ROBOT_M = 0.2;
  const robotAt = (ahead = 0) => {
    const { nodeRefFromName: nodes, camera } = window.__viserMutable, robot = nodes['/robot'];
    if (!robot) return null;
    const place = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).multiply(robot.matrixWorld).elements;
    const [x, y, , w] = [0, 1, 2, 3].map((i) => place[12 + i] + ahead * place[i]);
    return [(x / w + 1) * width / 2, (1 - y / w) * height / 2];
  };
  // The robot and where it looks, as large at every zoom; rimmed in white, which is seen on any colour.
  const heading = over.insertBefore(document.createElementNS(SVG, 'svg'), names);
  heading.setAttribute('class', 'simaps-heading');
  heading.setAttribute('viewBox', '-50 -50 100 100');
  for (const d of ['M0 0 L42 -22 A48 48 0 0 1 42 22 Z', 'M15 -3.5 H28 V-9 L47 0 L28 9 V3.5 H15 Z'])
    heading.appendChild(document.createElementNS(SVG, 'path')).setAttribute('d', d);
  const disc = heading.insertBefore(document.createElementNS(SVG, 'circle'), heading.lastChild);
  const headed = () => {  // as CSS, '' for none
    const robot = toScreen && robotAt(), nose = robot && robotAt(ROBOT_M);
    if (!nose) return '';
    const [x, y] = [nose[0] - robot[0], nose[1] - robot[1]], reach = Math.hypot(x, y), large = Math.max(1, reach / ROBOT_PX);
    const radius = (Math.max(reach, LEAST_PX) / large).toFixed(1);
    if (disc.getAttribute('r') !== radius) disc.setAttribute('r', radius);
    return `translate(${robot.map((one) => `${one.toFixed(1)}px`)}) translate(-50%, -50%) rotate(${Math.atan2(y, x).toFixed(3)}rad) scale(${large.toFixed(2)})`;
  };
  const AIM_M = 0.1;  // as a click takes it, for objects have holes
  const aimedAt = (col, row) => {
    const reach = Math.floor(AIM_M / map.cell + 1e-6);
    let found = 0, least = reach * reach + 1;
    for (let y = row - reach; y <= row + reach; y++) for (let x = col - reach; x <= col + reach; x++) {
      const away = (x - col) ** 2 + (y - row) ** 2;
      if (away >= least || x < 0 || y < 0 || x >= map.cols || y >= map.rows || !map.ids[y * map.cols + x]) continue;
      [found, least] = [map.ids[y * map.cols + x], away];
    }
    return found;
  };
  const writeAll = (look, under) => {  // look: of the names, '' for none
    const taken = [];
    count = 0;
    leaders = [];
    writeTexts(taken, under);
    if (look && map) writeNames(taken, look);
    for (const left of spans.slice(count)) left.hidden = true;
  };
  const drawOver = (canvas, plain) => {
    const scale = window.devicePixelRatio || 1, context = drawing.getContext('2d');
    const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
    if (drawing.width !== w || drawing.height !== h) { drawing.width = w; drawing.height = h; }
    else context.clearRect(0, 0, w, h);
    drawn = false;
    let under = null, said = '', name = 0, spot = [0, 0];
    const known = map && map.number === state.map;  // else another is seen already, whose objects are still to come
    if (known && pointer && !pressed) {
      const box = canvas.getBoundingClientRect(), [x, y] = [pointer[0] - box.left, pointer[1] - box.top];
      name = named(x, y);
      const cell = cellAt(toScreen, x, y), robot = robotAt(), near = robot && Math.hypot(robot[0] - x, robot[1] - y) < ROBOT_PX;
      under = near ? null : map.objects.get(name || aimedAt(...cell));
      said = near ? ROBOT : under ? factsOf(under) : map.groundAt(...cell);
      spot = [x, y];
    }
    say(said, ...spot);
    writeAll(known ? plain ? 'simaps-name' : 'simaps-name simaps-pale' : '', name ? null : under);
    // The ranks of others, and neighbours that have a number; the map itself outlines the target, and what is selected.
    const meant = texts.some(([kind]) => kind === 'command'), ranked = texts.some(([, text]) => text.startsWith('▶'));
    for (const [kind, text, ...label] of known ? texts : []) {
      const one = (kind === 'why' ? !meant : kind === 'command' && ranked && !text.startsWith('▶')) && map.objects.get(label[8]);
      if (one && one.cells) draw(context, one, true);
    }
    if (leaders.length) lead(context);
    if (known && pointed) for (const one of map.shown) if (one.label === pointed) draw(context, one, true);
    for (const one of known ? [under, chosen] : []) if (one) draw(context, one, false);
    give(drawing, 'hidden', !drawn);  // some graphics go on showing what was last on a canvas that was only cleared
  };

  // The legend: what is pointed to is outlined, a press shows a class alone or fades it.
  const oneOf = (event) => (map && event.target.dataset && map.objects.get(Number(event.target.dataset.one))) || null;
  const entryOf = (event) => event.target.closest && event.target.closest('[data-class]');
  let step = 0;  // of merging, whose button the pointer is on
  const point = (event) => {
    if (event.pointerType === 'touch') return;  // a finger that scrolls points to nothing, and never leaves
    const button = event.target.closest && event.target.closest('button');
    const on = Number(((button && button.textContent.match(/^Step (\d{1,8}) of /)) || [0, 0])[1]);
    if (on !== step) tell({ type: 'step', number: step = on });
    const entry = entryOf(event), label = entry ? entry.dataset.class : null, square = oneOf(event);
    if (square) event.target.title = factsOf(square);
    if (label !== pointed || chosen !== square) { pointed = label; chosen = square; changed = true; }
  };
  window.addEventListener('pointerover', point, true);
  window.addEventListener('focusin', point, true);
  window.addEventListener('click', (event) => {
    const entry = entryOf(event), find = event.target.dataset && event.target.dataset.find;
    if (find) tell({ type: 'find', step: Number(find) });
    if (entry) tell({ type: 'class', name: entry.dataset.class, do: entry.dataset.do });
    const one = oneOf(event);
    if (one) tell({ type: 'named', id: one.id, x: map.xmin + one.x * map.cell, y: map.ymin + one.y * map.cell });
    if (event.target.closest && event.target.closest('.simaps-selected')) tell({ type: 'deselect' });
  }, true);
  let more = window.innerHeight >= 1000;  // whether all classes are listed; a new legend is folded up
  window.addEventListener('click', (event) => {  // at once: told after a frame, it would be folded up again meanwhile
    const summary = event.target.closest && event.target.closest('.simaps-more > summary');
    if (summary) more = !summary.parentElement.open;
  }, true);
  const shows = (label) => (state.only ? label === state.only : !(state.faded || []).includes(label));
  const pressEntries = () => {
    const folded = document.querySelector('.simaps-more');
    if (folded && folded.open !== more) folded.open = more;
    for (const entry of document.querySelectorAll('.simaps-legend [data-class]')) {
      const { class: label, do: action } = entry.dataset;
      const on = String(action === 'only' ? label === state.only : (state.faded || []).includes(label));
      if (entry.getAttribute('aria-pressed') !== on) entry.setAttribute('aria-pressed', on);
    }
  };

  // In the top view a drag moves the map and north stays up; the wheel comes closer to what is under the pointer.
  const hands = (controls) => {
    const can = controls.constructor.ACTION, top = state.view === TOP;
    give(controls.mouseButtons, 'left', top ? can.TRUCK : can.ROTATE);
    give(controls.touches, 'one', top ? can.TOUCH_TRUCK : can.TOUCH_ROTATE);
    give(controls.touches, 'two', can.NONE);
    give(controls, 'dollyToCursor', true);
  };
  // Two fingers: what is under each of them stays there. (The library's own pinch hardly comes closer.)
  const fingers = new Map();
  const spread = () => {
    const [[a, b], [c, d]] = [...fingers.values()];
    return [(a + c) / 2, (b + d) / 2, Math.max(Math.hypot(a - c, b - d), 1)];
  };
  const touch = (event) => {
    if (event.pointerType !== 'touch') return;
    const known = fingers.has(event.pointerId), place = [event.clientX, event.clientY];
    if (event.type === 'pointerdown' && inCanvas(event)) {
      fingers.set(event.pointerId, place);
      // A browser captures every touch by itself; viser takes that for a drag of a handle, and would miss the tap.
      if (event.target.hasPointerCapture(event.pointerId)) event.target.releasePointerCapture(event.pointerId);
    }
    if (event.type === 'pointerup' || event.type === 'pointercancel') fingers.delete(event.pointerId);
    if (event.type !== 'pointermove' || !known) return;
    const viser = window.__viserMutable, controls = viser.cameraControl;
    if (fingers.size !== 2 || !controls) { fingers.set(event.pointerId, place); return; }
    const [x, y, wide] = spread();
    fingers.set(event.pointerId, place);
    const [nowX, nowY, now] = spread(), closer = now / wide, box = viser.canvas.getBoundingClientRect();
    const [east, south] = [box.left + box.width / 2, box.top + box.height / 2];
    const metres = 2 * controls.distance * Math.tan(viser.camera.fov * Math.PI / 360) / box.height;  // of a pixel
    controls.truck((x - east - (nowX - east) / closer) * metres, (y - south - (nowY - south) / closer) * metres, false);
    controls.dollyTo(controls.distance / closer, false);
  };
  for (const kind of ['pointerdown', 'pointermove', 'pointerup', 'pointercancel']) window.addEventListener(kind, touch, true);
  // What was clicked is told by the panel; the hint comes back when the pointer moves.
  window.addEventListener('pointerup', () => { pointer = null; changed = true; }, true);
  // A click on a name is one on the object that has it; the scene would take what lies below the name.
  let down = null;
  window.addEventListener('pointerdown', (event) => {
    down = event.isPrimary && event.button === 0 && inCanvas(event) && toScreen ? [event.clientX, event.clientY] : null;
  }, true);
  window.addEventListener('pointerup', (event) => {
    const [x, y] = down || [0, 0], viser = window.__viserMutable;
    if (!down || Math.hypot(event.clientX - x, event.clientY - y) > CLICK_PX || covered(viser)) return;
    const box = over.getBoundingClientRect(), id = named(x - box.left, y - box.top);
    if (!id) return;
    event.target.dispatchEvent(new PointerEvent('pointercancel', { pointerId: event.pointerId, pointerType: event.pointerType, bubbles: true }));
    const place = floorAt(toScreen, x - box.left, y - box.top);
    tell({ type: 'named', id, x: place[0], y: place[1] });
  }, true);
  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const TAKES_ARROWS = 'input, textarea, select, [contenteditable], [role=slider], [role=tab], [role=option], [role=dialog]';
  window.addEventListener('keydown', (event) => {  // to what was found next, or before
    if (!(event.key in ARROWS) || !ARROWS[event.key][1] || !event.target.matches('textarea[aria-label=Find]')) return;
    event.preventDefault();
    tell({ type: 'find', step: ARROWS[event.key][1] });
  }, true);
  const TAKES_SPACE = 'button, summary, [role=tab], [role=button]';
  document.body.addEventListener('keydown', (event) => {  // viser would turn the map, too, while a slider is moved, or play
    const takes = ARROWS[event.key] ? TAKES_ARROWS : event.key === ' ' ? TAKES_SPACE : '';
    if (takes && event.target.closest && event.target.closest(takes)) event.stopPropagation();
  });
  window.addEventListener('keydown', (event) => {
    const step = ARROWS[event.key], viser = window.__viserMutable;
    if (!step || state.view !== TOP || !viser || !viser.cameraControl || !toScreen) return;
    if (event.ctrlKey || event.metaKey || event.altKey || !event.target.closest) return;
    if (event.target.closest(TAKES_ARROWS)) return;
    event.stopPropagation();
    const [a, b] = [at(toScreen, 0, 0), at(toScreen, 1, 0)], metre = Math.hypot(b[0] - a[0], b[1] - a[1]);
    viser.cameraControl.truck(step[0] * 60 / metre, step[1] * 60 / metre, true);
  }, true);

  const covered = (viser) => Object.keys(viser.nodeRefFromName).some((name) => name === '/picture' && viser.nodeRefFromName[name]);
  const marked = ({ nodeRefFromName: nodes }) => {
    if (texts.some(([kind]) => kind === 'command' || kind === 'why')) return true;
    return Object.keys(nodes).some((name) => nodes[name] && /^\/why\/.|^\/target$/.test(name));
  };
  let opened = '';
  const tellTabs = () => {  // which tabs are open: some work only while they are looked at
    const frame = document.querySelector('iframe[title=Tab]');
    const open = [...document.querySelectorAll('[role=tab][aria-selected=true]')].map((one) => one.textContent.trim());
    const now = frame ? [frame.src, ...open].join('|') : opened;
    if (now === opened) return;
    opened = now;
    tell({ type: 'tabs', open });
  };
  window.setInterval(tellTabs, 250);  // not at every frame
  let changed = true, before = '', legend = null;
  // While nothing has moved for a while it is enough to look a few times a second; a hand on the page is seen at once.
  const QUIET_MS = 1000, REST_LOOKS_MS = 100;
  let movedAt = 0, looking = 0;
  const lookSoon = () => {
    const resting = Date.now() - movedAt > QUIET_MS;
    looking = resting ? window.setTimeout(() => { looking = 0; window.requestAnimationFrame(tick); }, REST_LOOKS_MS) : 0;
    if (!resting) window.requestAnimationFrame(tick);
  };
  for (const kind of ['pointermove', 'pointerdown', 'wheel', 'keydown', 'resize']) window.addEventListener(kind, () => {
    movedAt = Date.now();
    if (!looking) return;
    window.clearTimeout(looking);
    looking = 0;
    window.requestAnimationFrame(tick);
  }, true);
  const tick = () => {
    lookSoon();
    const viser = window.__viserMutable, canvas = viser && viser.canvas;
    if (!canvas || !viser.nodeRefFromName) return;
    if (over.parentElement !== canvas.parentElement) canvas.parentElement.appendChild(over);
    give(coming, 'hidden', Boolean(viser.nodeRefFromName['/map']));
    readObjects();
    const entry = document.querySelector('.simaps-legend [data-class]');
    if (entry !== legend) { legend = entry; changed = true; }
    if (readState()) changed = true;
    if (readTexts()) changed = true;
    if (readDivide()) changed = true;
    const cut = document.querySelector('.simaps-change'), shown = cut && cut.offsetParent ? cut.dataset.shown : '';
    if (chip.textContent !== shown) chip.textContent = shown;
    give(chip, 'hidden', !shown || covered(viser));
    const only = state.only_text ? `${state.only_text} · show all` : '';
    if (alone.textContent !== only) alone.textContent = only;
    give(alone, 'hidden', !only || covered(viser));
    const facts = state.facts ? `${factsOf({ id: state.selected, facts: state.facts })} · more` : '';
    if (about.textContent !== facts) about.textContent = facts;
    give(about, 'hidden', !facts || covered(viser) || opened.split('|').includes(state.tab));
    if (viser.cameraControl) hands(viser.cameraControl);
    toScreen = look(viser, canvas);
    const isCovered = covered(viser);
    texts = allTexts.filter(([kind]) => (kind === 'compare') === isCovered);
    const plain = !marked(viser), bare = !toScreen || isCovered, top = state.view === TOP;
    const turned = top && !bare ? headed() : '';
    const now = `${turned}|${toScreen}|${width}|${height}|${plain}|${bare}|${top}`;
    if (toScreen && !bare && !top) { readUnder(); sayInSpace(viser, canvas, now); }
    if (now === before && !changed) return;
    movedAt = Date.now();
    before = now;
    changed = changed > 1;
    over.classList.toggle('simaps-covered', isCovered);
    pressEntries();
    if (toScreen) {
      const right = viser.nodeRefFromName['/map'].matrixWorld.clone().invert().multiply(viser.camera.matrixWorld).elements;
      compass.style.transform = `rotate(${Math.atan2(right[1], right[0]).toFixed(4)}rad)`;
    }
    heading.style.display = turned ? '' : 'none';
    heading.style.transform = turned;
    placeHandle();
    give(scale, 'hidden', !toScreen || !top);
    if (!scale.hidden) drawScale();
    if (bare || !top) give(drawing, 'hidden', true);
    give(names, 'hidden', !toScreen);
    if (bare || !toScreen) give(hint, 'hidden', true);
    if (!toScreen) return;
    if (bare) writeAll('', null);
    else if (top) drawOver(canvas, plain);
    else writeAll('', null);
  };
  window.requestAnimationFrame(tick);
})();
