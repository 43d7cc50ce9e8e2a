(() => {
  if (window.simapsPage) return;
  window.simapsPage = true;
  document.documentElement.lang = 'en';
  document.title = 'SI Maps';
  // A phone would widen the page for a list that opens beyond its edge, and the panels would go with it.
  const fit = document.querySelector('meta[name=viewport]');
  if (fit) fit.content = 'width=device-width, initial-scale=1, minimum-scale=1';

  const PHONE = window.matchMedia('(max-width: 36em)');  // as in page.css

  const press = (element) => {
    for (const kind of ['pointerdown', 'mousedown', 'pointerup', 'mouseup', 'click'])
      element.dispatchEvent(new (kind.startsWith('pointer') ? PointerEvent : MouseEvent)(kind,
        { bubbles: true, cancelable: true, button: 0, pointerId: 1, isPrimary: true }));
  };

  const OPEN = 'simaps-open-tabs';
  const tabs = () => [...document.querySelectorAll('[role=tab]')];
  const titleOf = (tab) => tab.textContent.trim();
  const titled = (title) => tabs().find((one) => titleOf(one) === title);
  const isOpen = (tab) => tab.getAttribute('aria-selected') === 'true';
  let wanted = [];
  try { wanted = JSON.parse(sessionStorage.getItem(OPEN)) || []; } catch { /* then the first tabs are open */ }
  const reopen = () => {
    for (const tab of wanted.length ? tabs() : []) {
      if (!wanted.includes(titleOf(tab))) continue;
      wanted = wanted.filter((title) => title !== titleOf(tab));
      if (!isOpen(tab)) press(tab);
    }
  };
  document.addEventListener('pointerdown', (event) => {
    if (!event.isTrusted) return;
    wanted = [];
    if (event.pointerType !== 'touch' || event.target.closest('button')) endHints(event);
  }, true);
  // A press ends all hints until the pointer leaves what was pressed: viser keeps that of a control that the press
  // replaces or hides, and opens that of a control that was pressed at once. So does typing.
  let pressedBox = null;
  const quiet = (box) => { pressedBox = box; document.documentElement.toggleAttribute('data-pressed', box !== null); };
  const endHints = (event) => {
    for (const one of document.querySelectorAll('.mantine-Tooltip-tooltip')) one.dataset.pressed = '';
    quiet((event.target.closest('.mantine-Flex-root') || event.target).getBoundingClientRect());
  };
  document.addEventListener('input', endHints, true);
  document.addEventListener('pointermove', ({ clientX: x, clientY: y }) => {
    if (pressedBox && (x < pressedBox.left || x > pressedBox.right || y < pressedBox.top || y > pressedBox.bottom)) quiet(null);
  }, true);
  window.addEventListener('pagehide', () => {
    const open = tabs().filter(isOpen).map(titleOf);
    try { if (open.length) sessionStorage.setItem(OPEN, JSON.stringify(open)); } catch { /* as above */ }
  });

  const nameControls = () => {
    for (const label of document.querySelectorAll('label[for]')) {
      const row = label.closest('.mantine-Flex-root');
      if (!row) continue;
      const text = label.textContent.trim();
      for (const one of row.querySelectorAll('input:not([type=hidden]), textarea:not([aria-hidden]), [role=slider]'))
        if (one.getAttribute('aria-label') !== text) one.setAttribute('aria-label', text);
    }
  };
  // A finger that scrolls the panels begins on a slider now and then: its thumb is dragged, its track takes taps alone.
  window.addEventListener('touchstart', (event) => {
    if (event.target.closest('.mantine-Slider-root') && !event.target.closest('.mantine-Slider-thumb'))
      event.stopImmediatePropagation();
  }, { capture: true, passive: true });
  // A typed number counts at Enter, on leaving its field, or after a pause: who types 90 does not mean 9 first.
  const TYPED_MS = 700;
  let typed = null, text = '', counting = 0, counts = false;
  const rewrite = (field) => {  // a field that is drawn anew meanwhile has its old number again
    if (field.value !== text) Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(field, text);
  };
  const count = () => {
    clearTimeout(counting);
    const field = typed;
    typed = null;
    if (!field) return;
    counts = true;
    rewrite(field);
    field.dispatchEvent(new InputEvent('input', { bubbles: true }));
    counts = false;
  };
  window.addEventListener('input', (event) => {
    if (counts || !event.target.matches('.mantine-NumberInput-input')) return;
    event.stopImmediatePropagation();
    if (typed !== event.target) count();
    [typed, text] = [event.target, event.target.value];
    clearTimeout(counting);
    counting = setTimeout(count, TYPED_MS);
  }, true);
  window.addEventListener('beforeinput', (event) => { if (event.target === typed) rewrite(typed); }, true);
  window.addEventListener('keydown', (event) => { if (['Enter', 'ArrowUp', 'ArrowDown'].includes(event.key)) count(); }, true);
  window.addEventListener('focusout', count, true);

  const hush = () => {  // viser's remark on graphics without a card would lie on the map
    for (const one of document.querySelectorAll('.mantine-Notification-root')) {
      if (!one.textContent.startsWith('Software WebGL') || one.hidden) continue;
      one.hidden = true;
      one.querySelector('button').click();
    }
  };
  let turned = '';
  const turnTo = () => {  // the tab that the page was told to open
    const told = document.querySelector('[data-simaps-tab]');
    const anew = told && told.dataset.turn !== turned, tab = anew && titled(told.dataset.simapsTab);
    if (anew && told.dataset.focus) toBox(told.dataset.focus, told.dataset.simapsTab, 30);
    if (anew && (tab || told.dataset.focus)) turned = told.dataset.turn;
    if (!tab || told.dataset.focus) return;
    const from = told.dataset.from.split('|').map(titled).filter(Boolean);
    if (isOpen(tab) || (from.length && !from.some(isOpen))) return;
    press(tab);
    tab.scrollIntoView({ block: 'nearest' });
  };
  const sheet = () => {  // on a phone the map ends where the panels begin
    const panels = document.querySelector('[style*="max-height: 60%"]');
    document.documentElement.style.setProperty('--simaps-sheet', `${panels ? panels.offsetHeight : 0}px`);
  };
  const SAYS = { 'Recorded build': 'How this map came about, frame by frame, as it was recorded: camera, masks, the map as it grew' };
  const fitTabs = () => {  // where the words of all tabs do not fit in one row, the last ones are icons with a tooltip
    for (const row of document.querySelectorAll('[data-dock-strip], .mantine-Tabs-list')) {
      const all = [...row.querySelectorAll(':scope > [role=tab]')], words = all.map(titleOf).join();
      const wide = row.clientWidth - parseFloat(getComputedStyle(row).paddingRight);
      if (wide <= 0 || row.dataset.fits === `${words} ${wide}`) continue;
      for (let one = row.parentElement; one && !['scroll', 'auto'].includes(getComputedStyle(one).overflowY); one = one.parentElement)
        if (getComputedStyle(one).overflowY === 'hidden' && row.role === 'tablist') one.style.overflowY = 'clip';  // or it would scroll away
      for (const one of all) { delete one.dataset.bare; one.title = SAYS[titleOf(one)] || titleOf(one); }
      const ends = () => all[all.length - 1].getBoundingClientRect().right - row.getBoundingClientRect().left + row.scrollLeft;
      for (let i = all.length - 1; i > 0 && ends() > wide + 1; i--) all[i].dataset.bare = '';
      row.dataset.fits = `${words} ${wide}`;
    }
  };
  let foundAt = -Infinity;  // when what was found was stepped through last: its arrows stay under the finger
  document.addEventListener('click', (event) => { if (event.target.closest('[data-find]')) foundAt = Date.now(); }, true);
  const finding = () => document.activeElement.matches('textarea[aria-label=Find]') || Date.now() - foundAt < 3000;
  const unfolded = () => document.querySelector('[aria-label="Collapse panel Recorded build"]');
  document.addEventListener('click', (event) => {  // a tab opens at its top, and on a phone takes the recorded build's place
    const row = event.target.closest('[role=tab]') && event.target.closest('[role=tablist]');
    if (row && PHONE.matches && unfolded()) unfolded().click();
    // There what is above the tabs makes room for the tab, unless something is being looked for with it.
    const rooms = row && PHONE.matches && !finding();
    for (let one = row && row.parentElement; one; one = one.parentElement) {
      if (!['scroll', 'auto'].includes(getComputedStyle(one).overflowY)) continue;
      one.scrollTop = 0;
      if (rooms) one.scrollTop = row.parentElement.getBoundingClientRect().top - one.getBoundingClientRect().top;
    }
  });
  document.addEventListener('click', (event) => {  // what is typed into a choice replaces it
    if (event.target.matches('input.mantine-Select-input')) event.target.select();
  });
  document.addEventListener('transitionend', (event) => {  // on a phone the recorded build opens below what is in sight
    const opened = event.propertyName === 'height' && event.target.querySelector('iframe[title="Recorded build"]');
    if (opened && PHONE.matches && unfolded()) opened.scrollIntoView({ block: 'end' });
  });
  const changeSeen = {};
  const BEGINS_PX = 60;  // where so much of it is in sight, the panel rests: the slider may be wanted again
  const showChange = () => {  // what a slider changed, or keeps two things apart, is said where it may be out of sight
    for (const name of ['.simaps-change', '.simaps-apart', '.simaps-detail']) {
      const said = document.querySelector(name), inSight = said && said.getBoundingClientRect().top < innerHeight - BEGINS_PX;
      if (said && said !== changeSeen[name] && !(inSight && name === '.simaps-change')) {
        said.scrollIntoView({ block: 'nearest' });
        const moved = document.activeElement.closest('.mantine-Slider-thumb');  // stays under the finger that moves it
        if (moved && name === '.simaps-change') moved.closest('.mantine-Flex-root').scrollIntoView({ block: 'nearest' });
      }
      changeSeen[name] = said;
    }
  };
  let selectedSeen = '';
  const showSelected = () => {  // what is selected next is read from its name on, not from where the one before was left
    const one = document.querySelector('.simaps-selected'), name = one ? one.textContent : '';
    if (name && name !== selectedSeen && !finding()) one.scrollIntoView({ block: 'nearest' });
    selectedSeen = name;
  };
  const placeHints = () => {  // beside the panels: below its control a hint would cover the next one
    const left = Math.max(...[...document.querySelectorAll('[data-dock-strip]')].map((one) => one.getBoundingClientRect().left));
    const beside = left > innerWidth / 2 ? `${Math.round(innerWidth - left + 8)}px` : '';
    document.documentElement.style.setProperty('--simaps-hints', beside);
    document.documentElement.toggleAttribute('data-hints-beside', beside !== '');
  };
  let waiting = 0;
  const soon = () => {
    if (!waiting) waiting = setTimeout(() => {
      waiting = 0;
      nameControls(); reopen(); turnTo(); hush(); sheet(); fitTabs(); showChange(); showSelected(); placeHints();
    }, 100);
  };
  window.addEventListener('resize', soon);
  new MutationObserver(soon).observe(document.body, { childList: true, subtree: true, characterData: true });
  nameControls();
  reopen();

  const root = document.documentElement;
  const originOf = (frame) => new window.URL(frame.src).origin;  // URL alone is the document's here
  const tellTheme = (frame) =>
    frame.contentWindow.postMessage({ simapsTheme: root.dataset.mantineColorScheme }, originOf(frame));
  const frames = () => [...document.querySelectorAll('iframe[src^="/"]')].filter((frame) => frame.contentWindow);
  const STOPS = 'a[href], button, input:not([type=hidden]), select, textarea, summary, iframe, [tabindex]';
  const isStop = (one) => one.tabIndex >= 0 && !one.disabled && one.getClientRects().length > 0
    && getComputedStyle(one).visibility !== 'hidden';
  const leave = (frame, step) => {
    const stops = [...document.querySelectorAll(STOPS)].filter(isStop);
    for (let i = 1; i < stops.length; i++) {
      const next = stops[(stops.indexOf(frame) + (step < 0 ? -i : i) + stops.length) % stops.length];
      next.focus();
      if (document.activeElement === next) return;
    }
  };
  window.addEventListener('message', (event) => {
    const frame = frames().find((one) => one.contentWindow === event.source && originOf(one) === event.origin);
    const said = event.data || {};
    if (!frame) return;
    if (said.simapsLeave) leave(frame, said.simapsLeave);
    else if (said.simapsKey) document.body.dispatchEvent(
      new KeyboardEvent('keydown', { ...said.simapsKey, bubbles: true, cancelable: true }));
    else tellTheme(frame);
  });
  new MutationObserver(() => frames().forEach(tellTheme))
    .observe(root, { attributes: true, attributeFilter: ['data-mantine-color-scheme'] });
  frames().forEach(tellTheme);

  const withText = (text) => {
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode())
      if (node.data.trim() === text && node.parentElement.offsetParent) return node.parentElement;
    return null;
  };
  const toBox = (label, tabName, tries, opened = new Set(), then = () => {}) => {
    const box = document.querySelector(`[aria-label="${label}"]`);
    if (box && box.offsetParent) {
      box.focus();
      if (box.select) box.select();  // what is typed there replaces it
      then(box);
      return;
    }
    if (tries === 0) return;
    const tab = titled(tabName);
    if (tab && !isOpen(tab)) press(tab);
    else for (let one = box; one; one = one.parentElement) {  // it may be in a folder that is closed
      const title = getComputedStyle(one).display === 'none' && one.previousElementSibling;
      if (title && !opened.has(title)) title.click();
      opened.add(title);
    }
    setTimeout(() => { nameControls(); toBox(label, tabName, tries - 1, opened, then); }, 120);
  };
  // Words that are typed outside every box go to the command box: their letters are no keys of the page. So a letter
  // counts as one only when no other follows at once; those that lead to a box, or are held, count immediately.
  const BOXES = 'textarea, select, input:not([type=checkbox]), [contenteditable]', WRITING = `${BOXES}, [role=dialog]`;
  const HELD_MS = 300, SLOW_MS = 1500, AT_ONCE = ['f', 'b'];
  let held = [], waits = 0, leads = false;
  const letGo = () => { clearTimeout(waits); [held, leads] = [[], false]; };
  const sendKey = ({ key, code, shiftKey, target }) => (target.isConnected && !target.matches('input') ? target : document.body).dispatchEvent(
    new KeyboardEvent('keydown', { key, code, shiftKey, bubbles: true, cancelable: true }));
  const release = () => {
    const [one] = held;
    held = [];
    if (!sendKey(one)) return;
    held = [{ ...one, sent: true }];  // no key of the page: it may begin a word that is typed slowly, or on a page that is busy
    waits = setTimeout(letGo, SLOW_MS);
  };
  // Until a pause the box gets all of them anew with each letter: drawn meanwhile, it would lose some.
  const handOver = (box) => {
    leads = box;
    Object.getOwnPropertyDescriptor(HTMLTextAreaElement.prototype, 'value').set.call(box, held.map((one) => one.key).join(''));
    box.dispatchEvent(new InputEvent('input', { bubbles: true }));
  };
  document.addEventListener('pointerdown', (event) => { if (event.isTrusted) letGo(); }, true);
  window.addEventListener('keydown', (event) => {
    const { key, target, repeat } = event, plain = !event.ctrlKey && !event.metaKey && !event.altKey;
    const box = target.closest && target.closest(WRITING);
    if (!event.isTrusted || !target.closest || (box && box !== leads) || key === 'Shift') return;
    if (!plain || key.length !== 1) { letGo(); return; }
    const gap = held.length === 1 ? event.timeStamp - held[0].at : 0;  // a busy page may see to keys before its clocks
    if (gap > HELD_MS && !held[0].sent) { clearTimeout(waits); release(); }
    if (gap > SLOW_MS) letGo();
    if (!held.length && (repeat || !/^[a-z]$/i.test(key) || AT_ONCE.includes(key) || !titled('Command'))) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!repeat) held.push({ key, code: event.code, shiftKey: event.shiftKey, target, at: event.timeStamp });
    clearTimeout(waits);
    if (held.length === 1) { waits = setTimeout(release, HELD_MS); return; }
    waits = setTimeout(letGo, 3000);
    if (leads && leads !== true) handOver(leads);
    if (leads) return;
    leads = true;
    toBox('Command', 'Command', 10, new Set(), handOver);
  }, true);
  document.addEventListener('keydown', (event) => {
    const busy = event.target.closest && event.target.closest(BOXES);
    if (busy || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === '/') { event.preventDefault(); toBox('Command', 'Command', 3); }
    if (event.key === 'f') { event.preventDefault(); toBox('Find', 'Instance', 3); }
    if (event.key === '?') { event.preventDefault(); const help = withText('Help'); if (help) help.click(); }
  });
  // Key B, as long as it is held, shows the map before the slider was moved.
  let peeking = false;
  const peek = (event) => {
    const down = event.type === 'keydown';
    if (event.key !== 'b' || event.repeat || down === peeking || event.ctrlKey || event.metaKey || event.altKey) return;
    if (down && event.target.closest && event.target.closest(BOXES)) return;
    const both = withText('Before and after') || withText('Showing before – press again for after');
    if (!both) return;
    peeking = down;
    both.click();
  };
  for (const kind of ['keydown', 'keyup']) document.addEventListener(kind, peek);
  // viser's keys miss Escape on a button whose hint is open, which keeps it, and on a box to tick; the page gets it then.
  let taken = null;
  document.documentElement.addEventListener('keydown', (event) => { taken = event; });
  const passEscape = (event) => {
    if (!event.isTrusted || !event.target.closest || event.target.closest(WRITING)) return;
    const missed = event.target.matches('input');
    setTimeout(() => {
      if (missed || taken !== event) document.body.dispatchEvent(
        new KeyboardEvent('keydown', { key: 'Escape', code: 'Escape', bubbles: true, cancelable: true }));
    }, 50);
  };
  const closeOf = () => {  // the button that closes what is open, where there is one
    const open = [...document.querySelectorAll('.mantine-Modal-content')].pop();
    return open && [...open.querySelectorAll('button')].find((one) => one.textContent.trim() === 'Close');
  };
  window.addEventListener('click', (event) => {  // beside it
    const close = event.target.matches('.mantine-Modal-inner, .mantine-Modal-overlay') && closeOf();
    if (close) close.click();
  });
  window.addEventListener('keydown', (event) => {
    const close = closeOf();
    if (event.key !== 'Escape') return;
    if (!close && event.target.matches && event.target.matches('textarea')) {  // the page's keys work again, this one too
      event.target.blur();
      if (event.target.ariaLabel === 'Command') setTimeout(() => document.body.dispatchEvent(
        new KeyboardEvent('keydown', { key: 'Escape', code: 'Escape', bubbles: true, cancelable: true })));
    }
    if (!close) { passEscape(event); return; }
    event.stopImmediatePropagation();
    close.click();
  }, true);
})();
