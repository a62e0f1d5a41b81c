// Compile Python in the bytecode of Pyodide's: every .py below a folder becomes a .pyc in its place.
//     node site/compile.mjs build/site/explorer/vendor folder
// Without assertions and docstrings, which pages do not show, a third less is downloaded.
import { pathToFileURL } from "node:url";

const [vendor, folder] = process.argv.slice(2);
const { loadPyodide } = await import(pathToFileURL(`${vendor}/pyodide.mjs`));
const pyodide = await loadPyodide({ indexURL: `${vendor}/` });
pyodide.mountNodeFS("/files", folder);
pyodide.runPython(`
import py_compile
from pathlib import Path

mode = py_compile.PycInvalidationMode.UNCHECKED_HASH
for file in Path("/files").rglob("*.py"):
    py_compile.compile(file, f"{file}c", file.name, doraise=True, optimize=2, invalidation_mode=mode)
    file.unlink()
`);
