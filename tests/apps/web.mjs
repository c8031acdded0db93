/* Tests of lull.wasm and lull.mjs: node web.mjs BIN_OF_WASM OIDN_DENOISE WEIGHTS FOLDER
 *
 * Prints `FAIL name: reason` and a closing line of counts. FOLDER holds what the tests write. */
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';
import { albedo, bin, color, height, native, normal, pfm, run, same, weights, width } from './web_common.mjs';

const { Denoiser } = await import(pathToFileURL(join(bin, 'lull.mjs')));
const module = readFileSync(join(bin, 'lull.wasm'));
const load = () => Denoiser.load(module, weights);

await run({
  async 'the bytes of the program'() {
    const lull = await load();
    const [c, a, n] = [pfm('c.pfm', color), pfm('a.pfm', albedo), pfm('n.pfm', normal)];
    same(lull.denoise({ width, height, color, albedo, normal }),
      native('--hdr', c, '--alb', a, '--nrm', n));
    same(lull.denoise({ width, height, color }), native('--hdr', c));
    same(lull.denoise({ width, height, color, content: 'ldr', albedo }),
      native('--ldr', c, '--alb', a));
    same(lull.denoise({ width, height, color, inputScale: 0.05 }), native('--hdr', c, '--is', '0.05'));
    same(lull.denoise({ width, height, albedo }), native('--alb', a));
    same(lull.denoise({ width, height, normal }), native('--nrm', n));
    const charts = normal.map((v, i) => (Math.floor(i / 3) % width) % 20 < 3 ? 0 : v);
    same(lull.denoise({ width, height, color, normal: charts, content: 'lightmap_hdr' }),
      native('--hdr', c, '--nrm', pfm('charts.pfm', charts), '-f', 'RTLightmap'));
  },
  async 'inputs of four channels, and of other types, are the same; none is changed'() {
    const lull = await load();
    const rgba = new Float32Array(4 * width * height).map((_, i) =>
      i % 4 === 3 ? 0.5 : color[3 * (i >> 2) + i % 4]);
    const before = rgba.slice();
    const wanted = Buffer.from(lull.denoise({ width, height, color }).buffer);
    same(lull.denoise({ width, height, color: rgba }), wanted);
    same(lull.denoise({ width, height, color: Array.from(color) }), wanted);
    assert.deepEqual(rgba, before);
  },
  async 'memory is kept from frame to frame, and none is lost'() {
    const lull = await load();
    const frame = () => lull.denoise({ width, height, color, albedo, normal });
    const first = Buffer.from(frame().buffer);
    const bytes = lull.memoryBytes;
    for (let i = 0; i < 5; i++) same(frame(), first);
    assert.equal(lull.memoryBytes, bytes);
  },
  async 'progress is told, and cancels'() {
    const lull = await load();
    const told = [];
    const wanted = lull.denoise({ width, height, color });
    lull.denoise({ width, height, color, onProgress: (fraction) => { told.push(fraction); } });
    assert.ok(told.length > 2 && told.every((f, i) => f >= (told[i - 1] ?? 0) && f <= 1));
    assert.throws(() => lull.denoise({ width, height, color, onProgress: () => false }),
      (error) => error.cancelled && /cancel/i.test(error.message));
    same(lull.denoise({ width, height, color }), Buffer.from(wanted.buffer));
  },
  async 'errors say what is wrong, and leave the denoiser as it was'() {
    const lull = await load();
    const wrong = (options, text) => assert.throws(() => lull.denoise(options), text);
    wrong({ width, height }, /no image/);
    wrong({ width, height, color: color.subarray(3) }, /color has 15186 numbers/);
    wrong({ width: 0, height, color }, /whole numbers/);
    wrong({ width: 1.5, height, color }, /whole numbers/);
    wrong({ width: 2 ** 16, height: 2 ** 16, color: { length: 3 * 2 ** 32 } }, /no memory/);
    wrong({ width, height, color, content: 'raw' }, /content is one of hdr, ldr/);
    wrong({ width, height, albedo, content: 'hdr' }, /argument/i);
    wrong({ width, height, color, onProgress: () => { throw new Error('mine'); } }, /mine/);
    same(lull.denoise({ width, height, color }),
      Buffer.from((await load()).denoise({ width, height, color }).buffer));
    await assert.rejects(Denoiser.load(module, new Uint8Array(100)), /weights/i);
    await assert.rejects(Denoiser.load(new Uint8Array(8), weights), WebAssembly.CompileError);
  },
  async 'what a progress function throws takes no memory from the module'() {
    const lull = await load();
    const wanted = Buffer.from(lull.denoise({ width, height, color }).buffer);
    const mine = new Error('mine');
    const onProgress = () => { throw mine; };
    for (let i = 0; i < 400; i++)
      assert.throws(() => lull.denoise({ width, height, color, onProgress }), mine);
    same(lull.denoise({ width, height, color }), wanted);
  },
  async 'modules, promises and responses are taken'() {
    const compiled = await WebAssembly.compile(module);
    const lull = await Denoiser.load(compiled, Promise.resolve(new Response(weights)));
    same(lull.denoise({ width, height, color }),
      Buffer.from((await load()).denoise({ width, height, color }).buffer));
    const lost = new Response(null, { status: 404, statusText: 'Not Found' });
    await assert.rejects(Denoiser.load(compiled, lost), /404 Not Found/);
  },
  async 'the module asks for progress and nothing else'() {
    const imports = WebAssembly.Module.imports(await WebAssembly.compile(module));
    assert.deepEqual(imports.map(({ module: from, name }) => `${from}.${name}`), ['lull.progress']);
    assert.ok(module.length < 300_000, `${module.length} bytes`);
  },
});
