"use strict";
const KEY = "simaps-tab";
function stored() { try { return sessionStorage.getItem(KEY); } catch { return null; } }
function store(name) { try { sessionStorage.setItem(KEY, name); } catch { /* then a reload starts afresh */ } }
fetch("/tab/event" + location.search, {
  method: "POST", headers: { "Content-Type": "application/json" },
  // This frame is as wide as the page, and has no height.
  body: JSON.stringify({ type: "tab", tab: stored(), width: innerWidth, height: parent.innerHeight }),
}).then((answer) => answer.json()).then((answer) => { if (answer.tab) store(answer.tab); });
