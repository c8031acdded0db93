/* lull for JavaScript that must not wait: a Denoiser in a worker.
 *
 *     import { AsyncDenoiser } from './lull-async.mjs';
 *     const lull = await AsyncDenoiser.load((name) => fetch(name), fetch('kernel5_12.tza'));
 *     const clean = await lull.denoise({ width, height, color, albedo, normal });
 *
 * It wants lull.mjs and lull-async-worker.mjs beside this file, and no shared memory. What lull.mjs
 * wants for threads, it wants for threads.
 */
import { bytesOf, frameOf, listen, moduleFor, nodeWorker } from './lull.mjs';

const newWorker = async () => typeof Worker === 'function'
  ? new Worker(new URL('./lull-async-worker.mjs', import.meta.url), { type: 'module' })
  : nodeWorker(new URL('./lull-async-worker.mjs', import.meta.url));

const cancelled = () => Object.assign(new Error('lull: cancelled'), { cancelled: true });
const closed = () => new Error('lull: the denoiser is closed');

export class AsyncDenoiser {
  #found; // the module and what moduleFor says of it
  #weights;
  #worker = null;
  #closed = false;
  #turn = Promise.resolve(); // of the last frame
  #pending = null; // what the worker was asked: done(), failed(), told()
  #stop = null; // shared: not 0 cancels
  #memoryBytes = 0;

  /** As Denoiser.load; all threads are the worker's. */
  static async load(module, weights, { threads } = {}) {
    const self = new AsyncDenoiser();
    self.#found = await moduleFor(module, threads);
    self.#weights = new Uint8Array(await bytesOf(weights));
    if (typeof SharedArrayBuffer === 'function')
      self.#stop = new Int32Array(new SharedArrayBuffer(4));
    await self.#start();
    return self;
  }

  /** Threads that denoise. */
  get threads() {
    return this.#found.threads;
  }

  /** Why there is one thread where there might have been more; else ''. */
  get fallback() {
    return this.#found.fallback;
  }

  /** Bytes of memory that the module had taken after the last frame. */
  get memoryBytes() {
    return this.#memoryBytes;
  }

  /** Ends the worker and its threads; frames that are not done are rejected. */
  close() {
    this.#closed = true;
    this.#end(closed());
  }

  /** As Denoiser.denoise, with a promise of the result. The images are copied at once; frames are
   * denoised one after the other. onProgress is told every hundredth, and what it says is heard a
   * little later; to cancel where there is no SharedArrayBuffer the worker is ended, and another one
   * takes the next frame. */
  async denoise(options) {
    const { given } = frameOf(options);
    const { width, height, content, inputScale, onProgress } = options;
    const frame = { width, height, content, inputScale };
    for (const [name, image] of given) frame[name] = new Float32Array(image);
    const before = this.#turn;
    let over;
    this.#turn = new Promise((done) => { over = done; });
    try {
      await before;
      if (!this.#worker) await this.#start();
      if (this.#stop) Atomics.store(this.#stop, 0, 0);
      return await this.#ask({ frame, progress: Boolean(onProgress) },
        given.map(([name]) => frame[name].buffer), onProgress);
    } finally {
      over();
    }
  }

  async #start() {
    const { compiled, threads } = this.#found;
    const worker = this.#closed ? null : await newWorker();
    if (this.#closed) {
      worker?.terminate();
      throw closed();
    }
    this.#worker = worker;
    listen(worker, (message) => {
      if (worker === this.#worker) this.#hear(message);
    }, (error) => {
      if (worker === this.#worker) this.#end(error);
    });
    try {
      await this.#ask({ load: { compiled, weights: this.#weights, threads, stop: this.#stop } }, []);
    } catch (error) {
      this.#end(error);
      throw error;
    }
  }

  async #ask(message, transfer, onProgress) {
    try {
      return await new Promise((done, failed) => {
        this.#pending = { done, failed, onProgress, thrown: null };
        this.#worker.ref?.(); // Node is to wait for it, but not for a worker that has nothing to do
        this.#worker.postMessage(message, transfer);
      });
    } finally {
      this.#pending = null;
      this.#worker?.unref?.();
    }
  }

  #hear({ progress, error, isCancelled, done, memoryBytes }) {
    const { thrown } = this.#pending ?? {};
    if (progress !== undefined) this.#tell(progress);
    else {
      this.#memoryBytes = memoryBytes;
      if (thrown) this.#pending.failed(thrown);
      else if (error) this.#pending.failed(isCancelled ? cancelled() : new Error(error));
      else this.#pending.done(done);
    }
  }

  #tell(fraction) {
    if (this.#pending.thrown) return;
    try {
      if (this.#pending.onProgress(fraction) !== false) return;
      this.#pending.thrown = cancelled();
    } catch (error) {
      this.#pending.thrown = error;
    }
    if (this.#stop) Atomics.store(this.#stop, 0, 1);
    else this.#end(this.#pending.thrown);
  }

  #end(error) {
    this.#worker?.terminate();
    this.#worker = null;
    this.#pending?.failed(error);
  }
}
