/* Threads of lull-threads.wasm: the loops of the core, shared among instances of the module in one
 * memory. lull.mjs makes them, one in each worker; the caller's own is thread 0. */
#ifndef LULL_WEB_POOL_H
#define LULL_WEB_POOL_H

#define EXPORT(type, name, parameters)                                        \
    __attribute__((export_name(#name))) type name parameters; \
    type name parameters

/* Threads, the caller's included; 1 if none were started. */
unsigned pool_threads(void);

/* 1 if a worker failed. Loops are then no longer run, what they were to make is undefined, and
 * workers may still be writing it: they must be ended. */
int pool_failed(void);

/* lull_host.parallel_for; `user` is not used. */
void pool_for(void *user, unsigned count,
              void (*body)(void *context, unsigned index, unsigned worker), void *context);

#endif
