/* Tests of lull-threads.wasm:
 * node web_threads.mjs BIN_OF_WASM OIDN_DENOISE WEIGHTS FOLDER
 *
 * Prints `FAIL name: reason` and a closing line of counts. FOLDER holds what the tests write. */
import assert from 'node:assert/strict';
import { once } from 'node:events';
import { readFileSync } from 'node:fs';
import os from 'node:os';
import { join } from 'node:path';
import { Worker } from 'node:worker_threads';
import {
  albedo, bin, changed, color, copy, from, height, named, native, normal, pfm, run, same, script,
  trap, weights, weightsFile, width, withoutSharing,
} from './web_common.mjs';

const { Denoiser } = await from(bin, 'lull.mjs');
const load = (threads, file = weights) => Denoiser.load(named, file, { threads });
const frame = { width, height, color, albedo, normal };
const wanted = Buffer.from((await load(1)).denoise(frame).buffer);
const closed = /denoiser is closed/;

const silence = ['// the caller looks', 'return; // the caller looks']; // ... and nobody is told

/** Frames until a worker, which need not take part in every one, has failed. */
const untilFailure = `
  const lull = await Denoiser.load(named, weights, { threads: 2 });
  for (let i = 0; i < 1000; i++)
    try {
      lull.denoise({ width, height, color });
    } catch ({ message }) {
      try { lull.denoise({ width, height, color }); } catch (next) { console.log(message, next.message); }
      break;
    }`;
const vanished = script(copy('vanishing', [trap, silence]), untilFailure); // it takes ten seconds

await run({
  async 'any number of threads makes the bytes of the program'() {
    const [c, a, n] = [pfm('c.pfm', color), pfm('a.pfm', albedo), pfm('n.pfm', normal)];
    const all = native('--hdr', c, '--alb', a, '--nrm', n);
    const alone = native('--hdr', c, '--is', '0.05');
    for (const threads of [1, 2, 3]) {
      const lull = await load(threads);
      assert.deepEqual([lull.threads, lull.fallback], [threads, '']);
      for (let i = 0; i < 5; i++) {
        same(lull.denoise(frame), all);
        same(lull.denoise({ width, height, color, inputScale: 0.05 }), alone);
      }
      lull.close();
    }
  },
  async 'networks of both kinds, and frames that memory must grow for'() {
    const larger = { width: 700, height: 40, color: new Float32Array(4 * 700 * 40).map((_, i) => i % 97) };
    for (const name of ['kernel5_32.tza', 'rt_hdr_w16.tza']) {
      const file = readFileSync(join(weightsFile, '..', name));
      const [lull, alone] = [await load(2, file), await load(1, file)];
      const bytes = lull.memoryBytes;
      for (const it of [{ width, height, color }, larger, { width, height, color }])
        same(lull.denoise(it), Buffer.from(alone.denoise(it).buffer));
      assert.ok(lull.memoryBytes > bytes);
      lull.close();
    }
  },
  async 'a function is asked for the module that is needed'() {
    const asked = [];
    const module = (name) => { asked.push(name); return named(name); };
    for (const threads of [1, 2, undefined])
      (await Denoiser.load(module, weights, { threads })).close();
    await withoutSharing(async () => (await Denoiser.load(module, weights, { threads: 2 })).close());
    const usual = Math.min(os.availableParallelism?.() ?? os.cpus().length, 8);
    assert.deepEqual(asked, ['lull.wasm', 'lull-threads.wasm',
      usual > 1 ? 'lull-threads.wasm' : 'lull.wasm', 'lull.wasm']);
    const direct = await Denoiser.load(named('lull-threads.wasm'), weights);
    assert.equal(direct.threads, usual);
    direct.close();
    await assert.rejects(Denoiser.load(named('lull.wasm'), weights, { threads: 2 }), /has one thread/);
    for (const threads of [0, 65, 1.5, '2']) await assert.rejects(load(threads), /whole number from 1/);
  },
  'without shared memory there is one thread, and a reason': () => withoutSharing(async () => {
    const lull = await load(3);
    assert.equal(lull.threads, 1);
    assert.match(lull.fallback, /one thread: there is no SharedArrayBuffer/);
    same(lull.denoise(frame), wanted);
    assert.equal((await Denoiser.load(named('lull.wasm'), weights)).fallback, '');
    await assert.rejects(Denoiser.load(named('lull-threads.wasm'), weights), /no SharedArrayBuffer/);
    await changed(globalThis, 'crossOriginIsolated', false, async () =>
      assert.match((await load()).fallback, /Cross-Origin-Embedder-Policy: require-corp/));
  }),
  'threads of a page, where the main one must not sleep': () => changed(Atomics, 'wait', () => {
    throw new TypeError('Atomics.wait cannot be called in this context');
  }, async () => {
    const lull = await load(3);
    for (let i = 0; i < 5; i++) same(lull.denoise(frame), wanted);
    lull.close();
  }),
  async 'memory of fewer addresses is taken where 4 GiB are not to be had'() {
    const { Memory } = WebAssembly;
    const limits = [];
    class Small {
      constructor(limit) {
        limits.push(limit.maximum);
        if (limit.maximum > 8192) throw new RangeError('could not allocate memory');
        return new Memory(limit);
      }
    }
    await changed(WebAssembly, 'Memory', Small, async () => {
      const lull = await load(2);
      same(lull.denoise(frame), wanted);
      lull.close();
    });
    assert.deepEqual(limits, [65536, 32768, 16384, 8192]);
  },
  async 'close ends the workers, and not while they work'() {
    const workers = new Set();
    const { postMessage } = Worker.prototype;
    await changed(Worker.prototype, 'postMessage', function (...all) {
      workers.add(this);
      return postMessage.apply(this, all);
    }, async () => {
      const lull = await load(3);
      const onProgress = () => lull.close();
      assert.throws(() => lull.denoise({ ...frame, onProgress }), /closed by onProgress/);
      same(lull.denoise(frame), wanted);
      assert.equal(workers.size, 2);
      const ends = Promise.all([...workers].map((worker) => worker.threadId > 0 && once(worker, 'exit')));
      lull.close();
      lull.close();
      await ends;
      assert.throws(() => lull.denoise(frame), closed);
      assert.equal(lull.memoryBytes, 0);
    });
    const single = await load(1);
    single.close();
    assert.throws(() => single.denoise(frame), closed);
  },
  async 'progress cancels, and the next frame is as it should be'() {
    const lull = await load(2);
    const told = [];
    lull.denoise({ ...frame, onProgress: (fraction) => { told.push(fraction); } });
    assert.ok(told.length > 2 && told.every((f, i) => f >= (told[i - 1] ?? 0) && f <= 1));
    for (let i = 0; i < 20; i++) {
      let calls = 0;
      assert.throws(() => lull.denoise({ ...frame, onProgress: () => calls++ < 5 * i }),
        ({ cancelled }) => cancelled);
      same(lull.denoise(frame), wanted);
    }
    const onProgress = () => lull.denoise(frame);
    assert.throws(() => lull.denoise({ ...frame, onProgress }), /one frame at a time/);
    lull.close();
  },
  async 'two denoisers at once'() {
    const [first, second] = [await load(2), await load(3)];
    let inner = 0;
    const onProgress = () => { if (inner++ === 10) same(second.denoise(frame), wanted); };
    same(first.denoise({ ...frame, onProgress }), wanted);
    assert.ok(inner > 10);
    first.close();
    same(second.denoise(frame), wanted);
    second.close();
  },
  async 'a worker that does not start is an error'() {
    const place = copy('without-worker');
    const lost = (await from(place, 'lull.mjs')).Denoiser.load(named, weights, { threads: 2 });
    await assert.rejects(lost, /a worker failed: .*lull-worker\.mjs/);
    const broken = copy('broken-worker', [['lull: { progress: never', 'lull: { nothing: never']]);
    const wrong = (await from(broken, 'lull.mjs')).Denoiser.load(named, weights, { threads: 3 });
    await assert.rejects(wrong, /a worker failed: LinkError/);
  },
  async 'a worker that fails is an error, and closes the denoiser'() {
    const { stdout } = await script(copy('failing', [trap]), untilFailure);
    assert.match(stdout, /^lull: a worker failed: RuntimeError: .*the denoiser is closed\n$/);
  },
  async 'a worker that is no more is an error, and no end of waiting'() {
    const { stdout } = await vanished;
    assert.match(stdout, /^lull: a worker failed: it does not answer .*the denoiser is closed\n$/);
  },
  async 'Node ends though workers wait'() {
    await script(bin, `const lull = await Denoiser.load(named, weights, { threads: 3 });
      lull.denoise({ width, height, color });`);
  },
  async 'the module asks for memory, progress and a clock'() {
    const module = named('lull-threads.wasm');
    const imports = WebAssembly.Module.imports(await WebAssembly.compile(module));
    assert.deepEqual(imports.map(({ module: its, name }) => `${its}.${name}`).sort(),
      ['env.memory', 'lull.clock', 'lull.progress']);
    assert.ok(module.length < 300_000, `${module.length} bytes`);
  },
});
