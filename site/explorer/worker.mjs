// Echelon in Pyodide: answers {id, request} with {id, reply}; see explorer.py for what is asked and answered.
import { loadPyodide } from "./vendor/pyodide.mjs";

const say = (progress) => self.postMessage({ progress });

async function start() {
  const indexURL = new URL("vendor/", import.meta.url).href;
  say("Python is loading …");
  const { missing } = await (await fetch(`${indexURL}pyodide-lock.json`)).json();
  if (missing.length) throw new Error(`this copy of the site was built without ${missing.join(", ")}`);
  const pyodide = await loadPyodide({ indexURL });
  say("Echelon is loading …");
  await pyodide.loadPackage("echelon-robotics", { messageCallback() {} });
  const { answer } = pyodide.pyimport("explorer");
  self.postMessage({ ready: performance.now() });
  return answer;
}

const started = start();
started.catch(() => {}); // the reply to the first request says it

self.onmessage = async ({ data: { id, request } }) => {
  let reply;
  try {
    reply = JSON.parse((await started)(JSON.stringify(request)));
  } catch (error) {
    const lines = String(error.message ?? error).trim().split("\n");
    reply = { error: `echelon: ${lines[lines.length - 1]}` };
  }
  self.postMessage({ id, reply });
};
