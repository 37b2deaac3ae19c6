// Reading the data of the page.

class Trouble extends Error {}

async function read() {
  const held = byId("data");
  let text = held?.textContent.trim() ?? "";
  if (!text) throw new Trouble("This page has no matrix: its data element is empty.");
  if (held.dataset.encoding === "deflate") {
    if (typeof DecompressionStream !== "function") {
      throw new Trouble("This browser can't read the page's data, because it has no DecompressionStream. Firefox 113, Safari 16.4 and Chrome 80 have it, as have later ones.");
    }
    try {
      const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
      const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
      text = await new Response(stream).text();
    } catch {
      throw new Trouble("The page's data can't be decompressed. Is the file complete?");
    }
  }
  let data;
  try {
    data = JSON.parse(text);
  } catch (error) {
    throw new Trouble(`The page's data isn't JSON: ${error.message}. Is the file complete?`);
  }
  const usable = Array.isArray(data?.matrices) && data.matrices.length > 0 &&
    data.matrices.every((m) => Array.isArray(m?.columns) && Array.isArray(m.rows) && m.rows.every((row) => typeof row?.name === "string"));
  if (!usable) throw new Trouble("The page's data has no matrix: it needs `matrices`, and each of them `columns` and `rows` with names.");
  return data.matrices;
}
