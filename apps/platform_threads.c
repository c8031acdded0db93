#include "platform.h"

#include <stdlib.h>

#ifndef LULL_WITH_THREADS
#define LULL_WITH_THREADS 1
#endif

#define STACK ((size_t)1 << 20) /* some systems give far less by default */

#if !LULL_WITH_THREADS

platform_lock *platform_lock_new(void) { return NULL; }
void platform_lock_free(platform_lock *lock) { (void)lock; }
void platform_lock_enter(platform_lock *lock) { (void)lock; }
void platform_lock_leave(platform_lock *lock) { (void)lock; }
void platform_lock_wait(platform_lock *lock) { (void)lock; }
void platform_lock_wake(platform_lock *lock) { (void)lock; }
void platform_thread_join(platform_thread *thread) { (void)thread; }

platform_thread *platform_thread_start(void (*run)(void *arg), void *arg)
{
    (void)run;
    (void)arg;
    return NULL;
}

#else

#if defined(_WIN32)

#include <windows.h>

struct platform_lock {
    SRWLOCK mutex;
    CONDITION_VARIABLE changed;
};

struct platform_thread {
    HANDLE handle;
    void (*run)(void *arg);
    void *arg;
};

static int lock_init(platform_lock *lock)
{
    InitializeSRWLock(&lock->mutex);
    InitializeConditionVariable(&lock->changed);
    return 0;
}

static void lock_end(platform_lock *lock) { (void)lock; }
static void enter(platform_lock *lock) { AcquireSRWLockExclusive(&lock->mutex); }
static void leave(platform_lock *lock) { ReleaseSRWLockExclusive(&lock->mutex); }
static void wake(platform_lock *lock) { WakeAllConditionVariable(&lock->changed); }

static void await(platform_lock *lock)
{
    SleepConditionVariableSRW(&lock->changed, &lock->mutex, INFINITE, 0);
}

static DWORD WINAPI main_of(void *arg)
{
    platform_thread *thread = arg;
    thread->run(thread->arg);
    return 0;
}

static int start(platform_thread *thread)
{
    thread->handle = CreateThread(NULL, STACK, main_of, thread, 0, NULL);
    return !thread->handle;
}

static void join(platform_thread *thread)
{
    WaitForSingleObject(thread->handle, INFINITE);
    CloseHandle(thread->handle);
}

#else

#include <pthread.h>

struct platform_lock {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
};

struct platform_thread {
    pthread_t handle;
    void (*run)(void *arg);
    void *arg;
};

static int lock_init(platform_lock *lock)
{
    if (pthread_mutex_init(&lock->mutex, NULL))
        return -1;
    if (!pthread_cond_init(&lock->changed, NULL))
        return 0;
    pthread_mutex_destroy(&lock->mutex);
    return -1;
}

static void lock_end(platform_lock *lock)
{
    pthread_cond_destroy(&lock->changed);
    pthread_mutex_destroy(&lock->mutex);
}

static void enter(platform_lock *lock) { pthread_mutex_lock(&lock->mutex); }
static void leave(platform_lock *lock) { pthread_mutex_unlock(&lock->mutex); }
static void wake(platform_lock *lock) { pthread_cond_broadcast(&lock->changed); }
static void await(platform_lock *lock) { pthread_cond_wait(&lock->changed, &lock->mutex); }

static void *main_of(void *arg)
{
    platform_thread *thread = arg;
    thread->run(thread->arg);
    return NULL;
}

static int start(platform_thread *thread)
{
    pthread_attr_t attributes;
    int error = pthread_attr_init(&attributes);
    if (error)
        return error;
    error = pthread_attr_setstacksize(&attributes, STACK);
    if (!error)
        error = pthread_create(&thread->handle, &attributes, main_of, thread);
    pthread_attr_destroy(&attributes);
    return error;
}

static void join(platform_thread *thread) { pthread_join(thread->handle, NULL); }

#endif

platform_lock *platform_lock_new(void)
{
    platform_lock *lock = malloc(sizeof *lock);
    if (lock && lock_init(lock)) {
        free(lock);
        return NULL;
    }
    return lock;
}

void platform_lock_free(platform_lock *lock)
{
    if (lock)
        lock_end(lock);
    free(lock);
}

void platform_lock_enter(platform_lock *lock)
{
    if (lock)
        enter(lock);
}

void platform_lock_leave(platform_lock *lock)
{
    if (lock)
        leave(lock);
}

void platform_lock_wait(platform_lock *lock)
{
    if (lock)
        await(lock);
}

void platform_lock_wake(platform_lock *lock)
{
    if (lock)
        wake(lock);
}

platform_thread *platform_thread_start(void (*run)(void *arg), void *arg)
{
    platform_thread *thread = malloc(sizeof *thread);
    if (!thread)
        return NULL;
    thread->run = run;
    thread->arg = arg;
    if (!start(thread))
        return thread;
    free(thread);
    return NULL;
}

void platform_thread_join(platform_thread *thread)
{
    join(thread);
    free(thread);
}

#endif
