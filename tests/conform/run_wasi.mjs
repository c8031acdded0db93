/* Runs a program for WASI: node run_wasi.mjs PROGRAM.wasm [ARGUMENT...] */
import { readFileSync } from 'node:fs';
import { WASI } from 'node:wasi';

const [, , file, ...rest] = process.argv;
const wasi = new WASI({
  version: 'preview1', args: [file, ...rest], env: process.env,
  preopens: { '/': '/', '.': '.' }, // the C library tries the last one first
});
const { instance } = await WebAssembly.instantiate(readFileSync(file), {
  wasi_snapshot_preview1: wasi.wasiImport,
});
process.exitCode = wasi.start(instance);
