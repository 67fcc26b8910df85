/*
 * Preloaded into linux.uml (LD_PRELOAD): the guest's clock goes slower than this machine's, by the
 * whole number in SLOWER, so that a processor on which every system call costs some microseconds
 * is fast enough, in the guest's time, for a period of 10 ms.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>

#define SECOND 1000000000LL

typedef int (*reader)(clockid_t, struct timespec *);
typedef int (*setter)(timer_t, int, const struct itimerspec *, struct itimerspec *);
typedef int (*getter)(timer_t, struct itimerspec *);

static long long slower(void)
{
	static long long factor;
	if (!factor) {
		const char *told = getenv("SLOWER");
		factor = told ? atoll(told) : 1;
		if (factor < 1)
			factor = 1;
	}
	return factor;
}

static long long nanoseconds(struct timespec t)
{
	return t.tv_sec * SECOND + t.tv_nsec;
}

static struct timespec spec(long long nanoseconds)
{
	return (struct timespec){nanoseconds / SECOND, nanoseconds % SECOND};
}

int clock_gettime(clockid_t clock, struct timespec *t)
{
	static reader libc;
	static long long start[2];
	if (!libc)
		libc = (reader)dlsym(RTLD_NEXT, "clock_gettime");
	int failed = libc(clock, t);
	if (failed || (clock != CLOCK_REALTIME && clock != CLOCK_MONOTONIC))
		return failed;
	long long now = nanoseconds(*t);
	if (!start[clock])
		start[clock] = now;
	*t = spec(start[clock] + (now - start[clock]) / slower());
	return 0;
}

int timer_settime(timer_t timer, int flags, const struct itimerspec *set, struct itimerspec *old)
{
	static setter libc;
	if (!libc)
		libc = (setter)dlsym(RTLD_NEXT, "timer_settime");
	struct itimerspec later = {
		.it_interval = spec(nanoseconds(set->it_interval) * slower()),
		.it_value = spec(nanoseconds(set->it_value) * slower()),
	};
	return libc(timer, flags, &later, old);
}
