// Echelon in Pyodide: answers {id, request} with {id, reply}; see explorer.py for what is asked and answered.
import { loadPyodide } from "./vendor/pyodide.mjs";

const PACKAGES = "/lib/python3.14/site-packages";
const BLOCK = 512; // of an archive of tar

const vendored = (name) => new URL(`vendor/${name}`, import.meta.url).href;
const say = (progress) => self.postMessage({ progress });

async function start() {
  say("Python is loading …");
  const files = archive(); // on its way while Python starts
  const lock = fetch(vendored("pyodide-lock.json")).then((response) => response.json());
  files.catch(() => {});
  const pyodide = await loadPyodide({ indexURL: vendored(""), lockFileContents: lock });
  const { missing } = await lock;
  if (missing.length) throw new Error(`this copy of the site was built without ${missing.join(", ")}`);
  say("Echelon is loading …");
  unpack(await files, pyodide.FS);
  const { answer } = pyodide.pyimport("explorer");
  self.postMessage({ ready: performance.now() });
  return answer;
}

/** The content of the archive of packages, decompressed by the browser. */
async function archive() {
  const { body } = await fetch(vendored("packages.bin"));
  return new Uint8Array(await new Response(body.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
}

/** Write the files of an archive where Python looks for packages; nothing is copied. */
function unpack(bytes, FS) {
  const text = (from, length) => new TextDecoder().decode(bytes.subarray(from, from + length)).split("\0")[0];
  for (let at = 0; bytes[at]; ) {
    const path = [PACKAGES, text(at + 345, 155), text(at, 100)].filter(Boolean).join("/");
    const [start, size] = [at + BLOCK, parseInt(text(at + 124, 12), 8)];
    FS.mkdirTree(path.slice(0, path.lastIndexOf("/")));
    FS.writeFile(path, bytes.subarray(start, start + size), { canOwn: true });
    at = start + Math.ceil(size / BLOCK) * BLOCK;
  }
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
