"use strict";
const KEY = "simaps-tab";
function stored() { try { return sessionStorage.getItem(KEY); } catch { return null; } }
function store(name) { try { sessionStorage.setItem(KEY, name); } catch { /* then a reload starts afresh */ } }
fetch("/tab/event" + location.search, {
  method: "POST", headers: { "Content-Type": "application/json" },
  body: JSON.stringify({ type: "tab", tab: stored(), width: innerWidth }),
}).then((answer) => answer.json()).then((answer) => { if (answer.tab) store(answer.tab); });
