// The server: every request carries the token of the address.

const token = new URLSearchParams(location.search).get("token") ?? "";
const headers = { "x-sgpr-token": token };

async function answer(response) {
  if (response.ok) return response;
  const text = await response.text();
  let said = text;
  try { said = JSON.parse(text).error ?? text; } catch { /* plain text */ }
  throw new Error(said);
}

export async function get(path, values = {}, signal = undefined) {
  const query = new URLSearchParams(Object.entries(values).filter(([, value]) => value !== "" && value !== null));
  return answer(await fetch(`/api/${path}?${query}`, { headers, signal }));
}

export const getJson = async (...given) => (await get(...given)).json();

export async function post(path, body = {}) {
  const settings = { method: "POST", headers: { ...headers, "content-type": "application/json" }, body: JSON.stringify(body) };
  return (await answer(await fetch(`/api/${path}`, settings))).json();
}

export async function upload(file) {
  const path = `/api/upload?${new URLSearchParams({ name: file.name })}`;
  return (await answer(await fetch(path, { method: "POST", headers, body: file }))).json();
}

export async function save(what) {
  const content = await (await get(`take/${what}`)).blob();
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = what;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// Lines of the torque plots: head as JSON, then times as 64 and lines as 32 bit, each padded to 8 bytes.
export async function series(values, signal) {
  const buffer = await (await get("series", values, signal)).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let place = 4 + length;
  head.joints = head.joints.map((lines) => Object.fromEntries(lines.map(([name, count]) => {
    const t = new Float64Array(buffer, place, count);
    place += 8 * count;
    const y = new Float32Array(buffer, place, count);
    place += Math.ceil((4 * count) / 8) * 8;
    return [name, { t, y }];
  })));
  return head;
}
