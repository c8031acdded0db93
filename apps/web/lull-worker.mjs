/* A thread of lull.mjs's Denoiser: runs loops of lull-threads.wasm, in its caller's memory, until it
 * is terminated. */

const work = async ({ compiled, memory, stack, thread }, tell) => {
  let exports;
  try {
    const never = () => { throw new Error('not in a worker'); };
    ({ exports } = await WebAssembly.instantiate(compiled, {
      env: { memory }, lull: { progress: never, clock: never },
    }));
    exports.__stack_pointer.value = stack;
  } catch (error) {
    tell(String(error));
    return;
  }
  tell('ready');
  try {
    exports.work(thread);
  } catch (error) { // the caller looks into memory while it waits, not for messages
    const text = new TextEncoder().encode(String(error)).subarray(0, 255);
    new Uint8Array(memory.buffer, exports.why() >>> 0, 255).set(text);
    exports.fail();
  }
};

const ofNode = (name) => import(/* webpackIgnore: true */ /* @vite-ignore */ `node:${name}`);
if (typeof self === 'object' && typeof self.postMessage === 'function')
  self.onmessage = ({ data }) => work(data, (text) => self.postMessage(text));
else
  ofNode('worker_threads').then(({ parentPort: port }) =>
    port.once('message', (data) => work(data, (text) => port.postMessage(text))));
