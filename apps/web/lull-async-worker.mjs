/* The worker of lull-async.mjs: a Denoiser that is asked by messages, one at a time. */
import { Denoiser, ofNode } from './lull.mjs';

let lull, stop;

const load = async ({ compiled, weights, threads, stop: shared }) => {
  lull = await Denoiser.load(compiled, weights, { threads });
  stop = shared;
};

const denoise = (frame, tell) => {
  let next = 0;
  const onProgress = (fraction) => {
    if (tell && fraction >= next) {
      tell({ progress: fraction });
      next = fraction + 0.01;
    }
    return !stop || Atomics.load(stop, 0) === 0;
  };
  return lull.denoise({ ...frame, onProgress });
};

/** Answers a message with { done } or { error }, and tells progress before. */
const answer = async (message, tell) => {
  try {
    const done = message.load
      ? await load(message.load) : denoise(message.frame, message.progress && tell);
    tell({ done, memoryBytes: lull.memoryBytes }, done ? [done.buffer] : []);
  } catch (error) {
    const { message: text, cancelled } = error;
    tell({ error: text, isCancelled: cancelled, memoryBytes: lull?.memoryBytes ?? 0 });
  }
};

const teller = (port) => (what, transfer) => port.postMessage(what, transfer);

if (typeof self === 'object' && typeof self.postMessage === 'function')
  self.onmessage = ({ data }) => answer(data, teller(self));
else
  ofNode('worker_threads').then(({ parentPort }) =>
    parentPort.on('message', (data) => answer(data, teller(parentPort))));
