/* What the tests of lull's JavaScript share: images, files, the program, and how tests are run. The
 * arguments are BIN_OF_WASM OIDN_DENOISE WEIGHTS FOLDER. */
import assert from 'node:assert/strict';
import { execFile, execFileSync } from 'node:child_process';
import { copyFileSync, mkdirSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { promisify } from 'node:util';

export const [bin, oidnDenoise, weightsFile, folder] = process.argv.slice(2).map((path) => resolve(path));
export const weights = readFileSync(weightsFile);
export const [width, height] = [83, 61];

let state = 1;
const random = () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
const image = (value) => Float32Array.from({ length: 3 * width * height }, (_, i) =>
  value(Math.floor(i / 3) % width, Math.floor(i / 3 / width), i % 3));
export const albedo = image((x, y, c) => ((x >> 3) + (y >> 2)) % 2 ? 0.8 : 0.1 + 0.2 * c);
export const normal = image((x, y, c) => c === 2 ? 0.8 : 0.6 * (x > 40) * (c === 0));
export const color = image((x, y, c) =>
  -Math.log(1 - random()) * albedo[3 * (y * width + x) + c] * 2 ** (x / 16));

/** The rows of PFM files go upwards. */
const flipped = (bytes) => Buffer.concat(Array.from({ length: height }, (_, i) =>
  bytes.subarray((height - 1 - i) * width * 12, (height - i) * width * 12)));
export const pfm = (name, values) => {
  const path = join(folder, name);
  writeFileSync(path, Buffer.concat([Buffer.from(`PF\n${width} ${height}\n-1.0\n`),
    flipped(Buffer.from(values.buffer))]));
  return path;
};
/** What the program makes of files. */
export const native = (...inputs) => {
  const out = join(folder, 'native.pfm');
  execFileSync(oidnDenoise, [...inputs, '-w', weightsFile, '-o', out]);
  return flipped(readFileSync(out).subarray(-12 * width * height));
};
export const same = (values, bytes) =>
  assert.ok(Buffer.from(values.buffer).equals(bytes), 'other bytes');

export const from = (place, name) => import(pathToFileURL(join(place, name)));
export const named = (name) => readFileSync(join(bin, name));

/** What `test` does while an object's property is another. */
export const changed = async (object, name, value, test) => {
  const before = Object.getOwnPropertyDescriptor(object, name);
  Object.defineProperty(object, name, { configurable: true, writable: true, ...before, value });
  try {
    return await test();
  } finally {
    if (before) Object.defineProperty(object, name, before);
    else delete object[name];
  }
};
/** As in a page that is not isolated. */
export const withoutSharing = (test) => changed(globalThis, 'SharedArrayBuffer', undefined, test);


/** A copy of the JavaScript, where changes to lull-worker.mjs were made, or where it is not. */
export const copy = (name, changes) => {
  const place = join(folder, name);
  rmSync(place, { recursive: true, force: true });
  mkdirSync(place, { recursive: true });
  for (const file of readdirSync(bin))
    if (file.endsWith('.mjs')) copyFileSync(join(bin, file), join(place, file));
  rmSync(join(place, 'lull-worker.mjs'));
  if (!changes) return place;
  let text = readFileSync(join(bin, 'lull-worker.mjs'), 'utf8');
  for (const [before, after] of changes) {
    assert.ok(text.includes(before), before);
    text = text.replace(before, after);
  }
  writeFileSync(join(place, 'lull-worker.mjs'), text);
  return place;
};

/** A change that makes a worker fail in the middle of a loop. */
export const trap = ['__stack_pointer.value = stack', '__stack_pointer.value = 16'];

/** Runs a script with the JavaScript of `place`; it is to end by itself. */
export const script = (place, text) => promisify(execFile)(process.execPath,
  ['--input-type=module', '-e', `
    import { readFileSync } from 'node:fs';
    const from = (name) => import('${pathToFileURL(place)}/' + name);
    const { Denoiser } = await from('lull.mjs');
    const named = (name) => readFileSync(${JSON.stringify(bin)} + '/' + name);
    const weights = readFileSync(${JSON.stringify(weightsFile)});
    const [width, height] = [${width}, ${height}];
    const color = new Float32Array(3 * width * height).fill(0.5);
    ${text}`],
  { timeout: 60_000 });

/** Runs tests, by name, and prints `FAIL name: reason` and a closing line of counts. */
export const run = async (tests) => {
  let [passed, failed] = [0, 0];
  for (const [name, test] of Object.entries(tests)) {
    try {
      await test();
      passed++;
    } catch (error) {
      failed++;
      console.log(`FAIL ${name}: ${error.stack}`);
    }
  }
  console.log(`${passed} passed, ${failed} failed, 0 skipped`);
  process.exitCode = failed ? 1 : 0;
};
