// Runs the WebAssembly module. Messages in: { module } once, the module as gzip in base64; then { open, file, judge },
// { example, judge }, { judge } or { fly }: requests as host-sim/web/src/loaded_log.rs and example_flight.rs describe them. Messages out: { step, done },
// progress; { flight }, a step of a flight; { summary }, contents of the log; { judged } or { error }.
"use strict";
let wasm, file, position, shown;

// Copies the next bytes of the log; returns their number, -1 if the file cannot be read. The log is never in memory as a whole.
function copyLogBytes(into, length) {
  try {
    const bytes = new FileReaderSync().readAsArrayBuffer(file.slice(position, position + length));
    new Uint8Array(wasm.memory.buffer).set(new Uint8Array(bytes), into);
    position += bytes.byteLength;
    const percent = Math.floor((100 * position) / Math.max(1, file.size));
    if (percent !== shown) postMessage({ step: "Reading the log", done: (shown = percent) / 100 });
    return bytes.byteLength;
  } catch {
    return -1;
  }
}

const read = (at, length) => JSON.parse(new TextDecoder().decode(new Uint8Array(wasm.memory.buffer, at, length)));
const reportStep = (at, length) => postMessage({ flight: read(at, length) });

async function load(base64) {
  const packed = Uint8Array.from(atob(base64.trim()), (letter) => letter.charCodeAt(0));
  const bytes = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const { instance } = await WebAssembly.instantiate(await new Response(bytes).arrayBuffer(), { page: { copy_log_bytes: copyLogBytes, report_step: reportStep } });
  wasm = instance.exports;
}

// Calls a function of the module with a request; throws the error of its answer.
function call(name, request) {
  const bytes = new TextEncoder().encode(JSON.stringify(request));
  const at = wasm.request_buffer(bytes.length);
  new Uint8Array(wasm.memory.buffer, at, bytes.length).set(bytes);
  wasm[name]();
  const answer = read(wasm.answer(), wasm.answer_length());
  if (answer.error !== undefined) throw Object.assign(new Error(answer.error), { logs: answer.logs });
  return answer;
}

function answer({ open, example, judge, fly, file: next }) {
  if (fly) return postMessage({ judged: call("fly_example", fly) });
  if (example) postMessage({ summary: call("open_example", example) });
  if (open) {
    [file, position, shown] = [next, 0, -1];
    postMessage({ summary: call("open_log", open) });
  }
  postMessage({ step: "Evaluating the compasses" });
  postMessage({ judged: call("judge_log", judge) });
}

let loading;
onmessage = async ({ data }) => {
  if (data.module) return void (loading = load(data.module));
  try {
    await loading;
    answer(data);
  } catch (error) {
    // After a trap (a fault of the WebAssembly program) its memory is unusable: the page starts another worker.
    postMessage({ error: error.message, logs: error.logs, isFault: error instanceof WebAssembly.RuntimeError || wasm === undefined });
  }
};
