/* Tests of lull-async.mjs, with threads and without:
 * node web_async.mjs BIN_OF_WASM OIDN_DENOISE WEIGHTS FOLDER
 *
 * Prints `FAIL name: reason` and a closing line of counts. */
import assert from 'node:assert/strict';
import {
  albedo, bin, color, copy, from, height, named, normal, run, same, script, trap, weights,
  width, withoutSharing,
} from './web_common.mjs';

const { Denoiser } = await from(bin, 'lull.mjs');
const { AsyncDenoiser } = await from(bin, 'lull-async.mjs');
const load = (threads) => AsyncDenoiser.load(named, weights, { threads });
const frame = { width, height, color, albedo, normal };
const wanted = Buffer.from((await Denoiser.load(named, weights, { threads: 1 })).denoise(frame).buffer);
const closed = /denoiser is closed/;

await run({
  async 'makes the same, one frame after the other, and changes nothing'() {
    for (const lull of [await load(1), await load(2)]) {
      const before = color.slice();
      let told = 0;
      const frames = await Promise.all([frame, { ...frame, onProgress: () => { told++; } },
        { width, height, color: new Float32Array(4 * width * height).map((_, i) =>
          i % 4 === 3 ? 1 : color[3 * (i >> 2) + i % 4]), albedo: Array.from(albedo), normal }]
        .map((it) => lull.denoise(it)));
      for (const it of frames) same(it, wanted);
      assert.ok(told > 2);
      assert.deepEqual(color, before);
      assert.ok(lull.memoryBytes > 2 ** 20);
      lull.close();
    }
  },
  async 'two work side by side, and leave this thread alone'() {
    const lulls = [await load(1), await load(2)];
    let [ticks, over] = [0, false];
    const tick = () => { ticks++; if (!over) setImmediate(tick); };
    tick();
    for (const it of await Promise.all(lulls.map((lull) => lull.denoise(frame)))) same(it, wanted);
    over = true;
    assert.ok(ticks > 2);
    lulls.forEach((lull) => lull.close());
  },
  async 'cancels, with shared memory and without'() {
    const test = async () => {
      const lull = await load(2);
      const mine = new Error('mine');
      const big = { width: 700, height: 300, color: new Float32Array(3 * 700 * 300).fill(0.5) };
      await assert.rejects(lull.denoise({ ...big, onProgress: (f) => f < 0.1 }),
        (error) => error.cancelled && /cancel/i.test(error.message));
      same(await lull.denoise(frame), wanted);
      await assert.rejects(lull.denoise({ ...big, onProgress: () => { throw mine; } }), mine);
      same(await lull.denoise(frame), wanted);
      lull.close();
    };
    await test();
    await withoutSharing(test);
  },
  async 'errors are rejections'() {
    const lull = await load(2);
    await assert.rejects(lull.denoise({ width, height }), /no image/);
    await assert.rejects(lull.denoise({ width, height, albedo, content: 'hdr' }), /argument/i);
    const pending = [lull.denoise(frame), lull.denoise(frame)];
    lull.close();
    for (const it of [...pending, lull.denoise(frame)]) await assert.rejects(it, closed);
  },
  async 'what cannot be loaded is an error'() {
    await assert.rejects(AsyncDenoiser.load(named, new Uint8Array(100)), /weights/i);
    const place = copy('async-without-worker');
    const lost = (await from(place, 'lull-async.mjs')).AsyncDenoiser.load(named, weights, { threads: 2 });
    await assert.rejects(lost, /a worker failed: .*lull-worker\.mjs/);
  },
  async 'a thread that fails is an error, and no end of waiting'() {
    const { AsyncDenoiser: Failing } = await from(copy('async-failing', [trap]), 'lull-async.mjs');
    const lull = await Failing.load(named, weights, { threads: 2 });
    await assert.rejects(async () => {
      for (let i = 0; i < 1000; i++) await lull.denoise(frame); // it need not take part in every one
    }, /a worker failed: RuntimeError/);
    await assert.rejects(lull.denoise(frame), closed);
    lull.close();
  },
  async 'Node waits for frames, and not for workers'() {
    const { stdout } = await script(bin, `
      const { AsyncDenoiser } = await from('lull-async.mjs');
      const lull = await AsyncDenoiser.load(named, weights, { threads: 2 });
      lull.denoise({ width, height, color }).then(({ length }) => console.log(length));`);
    assert.equal(stdout, `${3 * width * height}\n`);
  },
});
