/*
 * Preloaded into linux.uml (LD_PRELOAD), for processors whose extended state is larger than that
 * kernel knows, as with AMX: the host takes the registers of a process only as a whole
 * (EFAULT otherwise). What the kernel does not know of no process in it can use.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

typedef long (*tracer)(enum __ptrace_request, pid_t, void *, void *);

static char whole[1 << 16] __attribute__((aligned(64)));
static size_t size;

long ptrace(enum __ptrace_request request, ...)
{
	static tracer libc_ptrace;
	va_list rest;
	va_start(rest, request);
	pid_t pid = va_arg(rest, pid_t);
	void *what = va_arg(rest, void *);
	void *data = va_arg(rest, void *);
	va_end(rest);

	if (!libc_ptrace)
		libc_ptrace = (tracer)dlsym(RTLD_NEXT, "ptrace");
	if (request != PTRACE_SETREGSET || (unsigned long)what != NT_X86_XSTATE)
		return libc_ptrace(request, pid, what, data);

	struct iovec *known = data, all = {whole, sizeof whole};
	if (!size) { /* what lies beyond is from now on as this process never used it */
		if (libc_ptrace(PTRACE_GETREGSET, pid, what, &all) < 0)
			return -1;
		size = all.iov_len;
		memset(whole, 0, sizeof whole);
	}
	if (known->iov_len >= size)
		return libc_ptrace(request, pid, what, data);
	memcpy(whole, known->iov_base, known->iov_len);
	all.iov_len = size;
	return libc_ptrace(PTRACE_SETREGSET, pid, what, &all);
}
