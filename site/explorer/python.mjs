// The worker that answers, and what the page asks of it; a script of its own, so that Python starts before all else.
const worker = new Worker("worker.mjs", { type: "module" });
const waiting = new Map(); // replies that are awaited, by id
let asked = 0;

/** Seconds from the beginning of the visit until Echelon can answer. */
export const ready = new Promise((resolve, reject) => {
  worker.onmessage = ({ data }) => {
    const status = document.getElementById("status");
    if (data.progress && status) status.textContent = data.progress;
    if (data.ready) resolve(performance.now() / 1000);
    if (data.id) waiting.get(data.id)?.(data.reply);
    waiting.delete(data.id);
  };
  worker.onerror = (event) => reject(new Error(`the page could not start: ${event.message ?? "a file is missing"}`));
});

/** The reply to a request. */
export function ask(request) {
  const id = ++asked;
  return new Promise((resolve) => {
    waiting.set(id, resolve);
    worker.postMessage({ id, request });
  });
}
