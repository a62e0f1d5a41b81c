// What the visitor chose, in the address: #robot=panda.yaml&gravity=none&locked=j2,j4, or a file's own text, packed.

export const USUAL = {
  floating: false, gravity: "file", zero: [], equal: [], locked: [], payload: "", sensors: [], effects: [],
  order: "base-to-tip", prefer: [], beside: [],
};

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
const listed = (values) => values.map((value) => encodeURIComponent(value)).join(",");
const read = (text) => (text ? text.split(",").map(decodeURIComponent) : []);

/** The part of the address after #. */
export async function written({ robot, name, text, changes }) {
  const parts = robot ? { robot } : { name, text: await packed(text) };
  for (const [key, usual] of Object.entries(USUAL)) {
    const value = changes[key];
    if (same(value, usual)) continue;
    if (key === "equal") parts.equal = value.map(listed).join(";");
    else parts[key] = Array.isArray(value) ? listed(value) : value === true ? "yes" : value;
  }
  return new URLSearchParams(parts).toString();
}

/** The state that an address stands for; what it does not say is as usual. */
export async function understood(hash) {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const changes = structuredClone(USUAL);
  for (const [key, usual] of Object.entries(USUAL)) {
    if (!parts.has(key)) continue;
    const value = parts.get(key);
    if (key === "equal") changes.equal = value.split(";").map(read).filter((pair) => pair.length === 2);
    else if (Array.isArray(usual)) changes[key] = read(value);
    else changes[key] = usual === false ? value === "yes" : value;
  }
  const own = parts.has("text") && parts.has("name");
  const text = own ? await unpacked(parts.get("text")) : null;
  return { robot: text === null ? parts.get("robot") : null, name: parts.get("name"), text, changes };
}

const through = (bytes, stream) => new Response(new Blob([bytes]).stream().pipeThrough(stream));

async function packed(text) {
  const stream = through(new TextEncoder().encode(text), new CompressionStream("deflate-raw"));
  const bytes = new Uint8Array(await stream.arrayBuffer());
  const letters = Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");
  return btoa(letters).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

async function unpacked(code) {
  try {
    const letters = atob(code.replaceAll("-", "+").replaceAll("_", "/"));
    const bytes = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
    return await through(bytes, new DecompressionStream("deflate-raw")).text();
  } catch {
    return null; // the link was cut off
  }
}
