/* lull for JavaScript: browsers, workers, Node, Deno.
 *
 *     import { Denoiser } from './lull.mjs';
 *     const lull = await Denoiser.load((name) => fetch(name), fetch('kernel5_12.tza'));
 *     const clean = lull.denoise({ width, height, color, albedo, normal });
 *
 * It returns when it is done; for pages that must not wait there is AsyncDenoiser of lull-async.mjs.
 *
 * Threads want lull-threads.wasm, lull-worker.mjs beside this file, and shared memory. Pages that are
 * cross-origin isolated have it: their server sends, with the page and with lull-worker.mjs,
 *
 *     Cross-Origin-Opener-Policy: same-origin
 *     Cross-Origin-Embedder-Policy: require-corp
 */

const CONTENTS = ['hdr', 'ldr', 'srgb', 'lightmap_hdr', 'lightmap_dir']; // lull_content
const FEATURES = { color: 1, albedo: 2, normal: 4 }; // LULL_HAS_*
const THREADS_MAX = 64; // of pool.c
const THREADS_USUAL = 8; // at most: a loop of the core is some 20 microseconds on two threads
const PAGES = 16; // of 64 KiB: the first memory of lull-threads.wasm, which the Makefile says
const STACK = 65536; // bytes for a worker: the linker's for the caller; the core takes 3 kB
const SPINS = 50_000; // how often a thread looks for work before it sleeps: some 0.05 ms

export const bytesOf = async (source) => {
  const from = await source;
  if (typeof Response !== 'undefined' && from instanceof Response) {
    if (!from.ok) throw new Error(`lull: ${from.url}: ${from.status} ${from.statusText}`);
    return new Uint8Array(await from.arrayBuffer());
  }
  return from instanceof Uint8Array ? from : new Uint8Array(from);
};

/** A module of Node, by a name that bundlers for browsers do not see. */
export const ofNode = (name) => import(/* webpackIgnore: true */ /* @vite-ignore */ `node:${name}`);

const processors = async () => {
  if (globalThis.navigator?.hardwareConcurrency) return navigator.hardwareConcurrency;
  try {
    const { availableParallelism, cpus } = await ofNode('os'); // Node has no navigator before 21
    return availableParallelism?.() ?? cpus().length;
  } catch {
    return 1;
  }
};

const noThreads = () => {
  if (typeof SharedArrayBuffer === 'function') return '';
  return 'there is no SharedArrayBuffer' + (typeof crossOriginIsolated === 'undefined' ? '' :
    ': the page is not cross-origin isolated, as it is where its server sends ' +
    'Cross-Origin-Opener-Policy: same-origin and Cross-Origin-Embedder-Policy: require-corp');
};

/** The module, compiled; whether its memory is shared; how many threads it will have, and why not
 * more. */
export const moduleFor = async (module, wanted) => {
  if (wanted !== undefined && !(Number.isInteger(wanted) && wanted >= 1 && wanted <= THREADS_MAX))
    throw new Error(`lull: threads is a whole number from 1 to ${THREADS_MAX}`);
  const no = noThreads();
  const threads = wanted ?? Math.min(await processors(), THREADS_USUAL);
  let code = await module;
  const asked = typeof code === 'function';
  if (asked) code = await code(threads > 1 && !no ? 'lull-threads.wasm' : 'lull.wasm');
  const compiled = code instanceof WebAssembly.Module
    ? code : await WebAssembly.compile(await bytesOf(code));
  const shared = WebAssembly.Module.imports(compiled).some(({ kind }) => kind === 'memory');
  if (shared && no) throw new Error(`lull: lull-threads.wasm cannot run: ${no}`);
  if (!shared && !no && threads > 1 && (asked || wanted))
    throw new Error('lull: this module has one thread; lull-threads.wasm has more');
  return { compiled, shared, threads: shared ? threads : 1,
           fallback: no && threads > 1 && (asked || wanted) ? `lull: one thread: ${no}` : '' };
};

/** Memory that grows up to 4 GiB, or less where that many addresses are not to be had. */
const sharedMemory = () => {
  for (let maximum = 65536; ; maximum /= 2)
    try {
      return new WebAssembly.Memory({ initial: PAGES, maximum, shared: true });
    } catch (error) {
      if (maximum <= 4096) throw error;
    }
};

/** The main thread of a page may not sleep. */
const maySleep = () => {
  try {
    return Atomics.wait(new Int32Array(new SharedArrayBuffer(4)), 0, 1) === 'not-equal';
  } catch {
    return false;
  }
};

/** A worker of Node, without the options that this thread was started with (--input-type, say). */
export const nodeWorker = async (url) =>
  new (await ofNode('worker_threads')).Worker(url, { execArgv: [] });

const newThread = async () => typeof Worker === 'function'
  ? new Worker(new URL('./lull-worker.mjs', import.meta.url), { type: 'module' })
  : nodeWorker(new URL('./lull-worker.mjs', import.meta.url));

const failure = (what) => new Error(`lull: a worker failed: ${what}`);

/** Calls told(message) for each message of a worker, failed(error) if it fails or ends. */
export const listen = (worker, told, failed) => {
  const error = (what) => failed(failure(what));
  if (worker.on)
    worker.on('message', told).on('error', error).on('exit', () => error('it is no more'));
  else {
    worker.addEventListener('message', ({ data }) => told(data));
    worker.addEventListener('error', (event) => {
      event.preventDefault();
      error(event.message ?? 'its script was not loaded; it is to be sent with the page\'s headers');
    });
  }
};

/** Checks a frame: its images, their names before them, and the number of its content. */
export const frameOf = ({ width, height, color, albedo, normal, content }) => {
  const given = Object.entries({ color, albedo, normal }).filter(([, image]) => image);
  if (!given.length) throw new Error('lull: no image');
  const kind = CONTENTS.indexOf(content ?? (color ? 'hdr' : 'ldr'));
  if (kind < 0) throw new Error(`lull: content is one of ${CONTENTS.join(', ')}`);
  if (![width, height].every((n) => Number.isInteger(n) && n > 0 && n <= 65536))
    throw new Error('lull: width and height are whole numbers from 1 to 65536');
  const pixels = width * height;
  for (const [name, image] of given)
    if (image.length !== 3 * pixels && image.length !== 4 * pixels)
      throw new Error(`lull: ${name} has ${image.length} numbers, not 3 or 4 for each pixel`);
  return { given, kind, pixels };
};

export class Denoiser {
  #exports = null;
  #memory = null;
  #workers = [];
  #progress = null; // while a frame is denoised
  #threads;
  #fallback;

  /**
   * The module and weights (a TZA file): each an ArrayBuffer, a Uint8Array, a Response, or a
   * promise of one. The module may also be a WebAssembly.Module; or a function that returns any of
   * these for a name: 'lull-threads.wasm' where there are to be threads, and can be, else 'lull.wasm'.
   *
   * threads   how many, the caller's included: up to 64. If not given as many as there are
   *           processors, but no more than 8; of a module that is lull.wasm one
   *
   * Throws an Error: weights that are none, workers that do not start.
   */
  static async load(module, weights, { threads } = {}) {
    const self = new Denoiser();
    const found = await moduleFor(module, threads);
    const imports = { lull: { progress: (fraction) => Number(self.#progress(fraction)),
                              clock: () => performance.now() } };
    if (found.shared) imports.env = { memory: sharedMemory() };
    const instance = await WebAssembly.instantiate(found.compiled, imports);
    self.#exports = instance.exports;
    self.#memory = imports.env?.memory ?? instance.exports.memory;
    self.#threads = found.threads;
    self.#fallback = found.fallback;
    const stacks = Array.from({ length: found.threads - 1 }, () => self.#allocate(STACK) + STACK);
    const file = await bytesOf(weights);
    const at = self.#allocate(file.length);
    new Uint8Array(self.#memory.buffer, at, file.length).set(file);
    self.#check(self.#exports.load(at, file.length));
    if (stacks.length) await self.#start(found.compiled, stacks);
    return self;
  }

  /** Threads that denoise, the caller's included. */
  get threads() {
    return this.#threads;
  }

  /** Why there is one thread where there might have been more; else ''. */
  get fallback() {
    return this.#fallback;
  }

  /** Bytes of memory that the module has taken; it keeps what its largest frame needed. */
  get memoryBytes() {
    return this.#memory?.buffer.byteLength ?? 0;
  }

  /** Ends the threads and lets go of the memory: nothing can be denoised afterwards. Threads that are
   * not ended so sleep until the page goes, or the program: Node does not wait for them. */
  close() {
    if (this.#progress) throw new Error('lull: closed by onProgress, which returns false to cancel');
    for (const worker of this.#workers) worker.terminate();
    this.#workers = [];
    this.#exports = this.#memory = null;
  }

  /**
   * Denoises a frame; the result is a new Float32Array of 3 numbers a pixel, rows from the top.
   *
   * width, height   pixels
   * color           radiance (or what `content` says), 3 or 4 numbers a pixel, any array of numbers;
   *                 a fourth one, as in RGBA, is left out
   * albedo, normal  optional: in [0, 1]; in [-1, 1], in any space. Without a color the albedo, or
   *                 the normals, are denoised
   * content         of the main image: 'hdr' (linear radiance, the default of colors), 'ldr' (linear,
   *                 at most 1, the default of others), 'srgb', 'lightmap_hdr', 'lightmap_dir' (where
   *                 the normal is 0 there is no surface: light from the nearest one stands there)
   * inputScale      brings radiance to the range the network knows; measured where not given
   * onProgress      is told the fraction done; cancels by returning false, or by an error
   *
   * Throws an Error: arrays of another size, features that the weights do not know, no memory,
   * cancelled (its `cancelled` is true), a worker that failed (the denoiser is closed then).
   */
  denoise(options) {
    const { given, kind, pixels } = frameOf(options);
    const { width, height, inputScale = NaN, onProgress } = options;
    if (!this.#exports) throw new Error('lull: the denoiser is closed');
    if (this.#progress) throw new Error('lull: one frame at a time');
    this.#exports.begin(width, height, kind);
    const places = given.map(([name, image]) => {
      const at = this.#allocate(12 * pixels);
      const to = new Float32Array(this.#memory.buffer, at, 3 * pixels);
      if (image.length === to.length) to.set(image);
      else
        for (let i = 0, j = 0; i < to.length; i += 3, j += 4) {
          to[i] = image[j];
          to[i + 1] = image[j + 1];
          to[i + 2] = image[j + 2];
        }
      this.#exports.set_image(FEATURES[name], at);
      return at;
    });
    const thrown = [];
    this.#progress = (fraction) => {
      try {
        return onProgress?.(fraction) !== false;
      } catch (error) { // must not pass the module: its stack would stay in use
        thrown.push(error);
        return false;
      }
    };
    const status = this.#run(inputScale);
    if (thrown.length) throw thrown[0];
    this.#check(status);
    return new Float32Array(this.#memory.buffer, places[0], 3 * pixels).slice();
  }

  async #start(compiled, stacks) {
    const spins = this.#threads > await processors() ? 0 : SPINS;
    this.#exports.start(this.#threads, spins, Number(maySleep()));
    try {
      for (const stack of stacks) this.#workers.push(await newThread());
      await Promise.all(this.#workers.map((worker, i) => new Promise((ready, failed) => {
        listen(worker, (text) => text === 'ready' ? ready() : failed(failure(text)), failed);
        worker.postMessage({ compiled, memory: this.#memory, stack: stacks[i], thread: i + 1 });
      })));
    } catch (error) {
      this.close();
      throw error;
    }
    for (const worker of this.#workers) worker.unref?.(); // Node would wait for its end
  }

  #run(inputScale) {
    const leave = () => {
      this.#progress = null;
      if (this.#workers.length) this.close(); // they may be at work still
    };
    let status, failed;
    try {
      status = this.#exports.run(inputScale);
      failed = this.#exports.failed?.();
    } catch (error) {
      leave();
      throw error;
    }
    this.#progress = null;
    if (failed) {
      const why = this.#text(this.#exports.why()) || 'it does not answer';
      leave();
      throw failure(why);
    }
    return status;
  }

  #allocate(bytes) {
    const at = bytes < 2 ** 32 && this.#exports.allocate(bytes) >>> 0;
    if (!at) throw new Error('lull: no memory');
    return at;
  }

  #text(at) {
    const text = new Uint8Array(this.#memory.buffer, at >>> 0);
    return new TextDecoder().decode(text.slice(0, text.indexOf(0))); // a copy: memory may be shared
  }

  #check(status) {
    if (status === 0) return;
    const error = new Error(`lull: ${this.#text(this.#exports.status_text(status))}`);
    error.cancelled = status === 1; // LULL_CANCELLED
    throw error;
  }
}
