// Counts the instructions of `splitplane-embree --count` one by one, on Linux with x86-64: what callgrind counts, with instructions
// that it does not know, such as AVX-512.
//
//   cc -O2 -o count_by_steps benches/embree/count_by_steps.c
//   RAYON_NUM_THREADS=1 ./count_by_steps target/release/splitplane-embree --library LIB --count --rays 1024 SCENE.obj
//
// The program's requests to callgrind are breakpoints: "are you there" is answered, and between two toggles the thread that asks
// goes step by step, some 200,000 steps a second. Prints what is counted and how many instructions it took.
#define _GNU_SOURCE
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/personality.h>
#include <sys/ptrace.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

// As in src/callgrind.rs.
enum { RUNNING = 0x1001, ZERO = 0x43540001, TOGGLE = 0x43540002, DUMP = 0x43540003 };
// A request: four rotations and an exchange, which is where the breakpoint goes.
static const unsigned char REQUEST[] = {0x48, 0xC1, 0xC7, 3, 0x48, 0xC1, 0xC7, 13, 0x48, 0xC1, 0xC7, 61,
                                        0x48, 0xC1, 0xC7, 51, 0x48, 0x87, 0xDB};
enum { EXCHANGE = 16, EXCHANGE_BYTES = 3, MOST = 256 };

static unsigned long sites[MOST];
static int site_count;

static unsigned long word(pid_t thread, unsigned long at) {
    return ptrace(PTRACE_PEEKDATA, thread, at, 0);
}

// Finds requests in the program's file, as addresses before it is loaded somewhere.
static void find_sites(const char *program) {
    FILE *file = fopen(program, "rb");
    if (!file) exit(2);
    fseek(file, 0, SEEK_END);
    long length = ftell(file);
    rewind(file);
    unsigned char *bytes = malloc(length);
    if (fread(bytes, 1, length, file) != (size_t)length) exit(2);
    fclose(file);
    unsigned long headers = *(unsigned long *)(bytes + 32);
    int count = *(unsigned short *)(bytes + 56);
    for (long i = 0; i + (long)sizeof REQUEST <= length; i++) {
        if (memcmp(bytes + i, REQUEST, sizeof REQUEST)) continue;
        for (int k = 0; k < count; k++) {
            unsigned char *header = bytes + headers + 56 * k;
            unsigned long offset = *(unsigned long *)(header + 8), at = *(unsigned long *)(header + 16);
            unsigned long size = *(unsigned long *)(header + 32);
            int is_loaded = *(unsigned *)header == 1;
            if (is_loaded && i >= (long)offset && i < (long)(offset + size) && site_count < MOST)
                sites[site_count++] = at + (i - offset) + EXCHANGE;
        }
    }
    free(bytes);
}

// Where the program was loaded: the first line that names its file.
static unsigned long loaded_at(pid_t process, const char *program) {
    char path[64], line[4096], *name = realpath(program, NULL);
    snprintf(path, sizeof path, "/proc/%d/maps", process);
    FILE *maps = fopen(path, "r");
    unsigned long base = 0;
    while (maps && !base && fgets(line, sizeof line, maps))
        if (name && strstr(line, name)) base = strtoul(line, NULL, 16);
    if (maps) fclose(maps);
    free(name);
    return base;
}

int main(int argc, char **argv) {
    if (argc < 2) {
        fprintf(stderr, "usage: count_by_steps PROGRAM ARGUMENTS\n");
        return 2;
    }
    find_sites(argv[1]);
    pid_t process = fork();
    if (!process) {
        personality(ADDR_NO_RANDOMIZE);
        ptrace(PTRACE_TRACEME, 0, 0, 0);
        execv(argv[1], argv + 1);
        _exit(127);
    }
    int status;
    waitpid(process, &status, 0);
    ptrace(PTRACE_SETOPTIONS, process, 0, PTRACE_O_TRACECLONE | PTRACE_O_EXITKILL);
    unsigned long base = loaded_at(process, argv[1]);
    for (int i = 0; i < site_count; i++) {
        sites[i] += base;
        ptrace(PTRACE_POKEDATA, process, sites[i], (word(process, sites[i]) & ~0xFFUL) | 0xCC);
    }
    unsigned long count = 0;
    int is_stepping = 0;
    // The thread that asked. Others may be waiting for work, which is no part of it.
    pid_t counted = process;
    ptrace(PTRACE_CONT, process, 0, 0);
    for (pid_t thread; (thread = waitpid(-1, &status, __WALL)) > 0;) {
        if (WIFEXITED(status) || WIFSIGNALED(status)) {
            if (thread == process) return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
            continue;
        }
        int passed_on = 0, signal = WSTOPSIG(status);
        if (signal == SIGTRAP && !(status >> 16)) {
            struct user_regs_struct registers;
            ptrace(PTRACE_GETREGS, thread, 0, &registers);
            int is_request = 0;
            for (int i = 0; i < site_count; i++) is_request |= registers.rip == sites[i] + 1;
            if (is_request) {
                unsigned long what = word(thread, registers.rax), with = word(thread, registers.rax + 8);
                registers.rip += EXCHANGE_BYTES - 1;
                if (what == RUNNING) registers.rdx = 1;
                if (what == ZERO) count = 0;
                if (what == TOGGLE) {
                    is_stepping = !is_stepping;
                    counted = thread;
                }
                if (what == DUMP) {
                    unsigned long name[32];
                    for (int i = 0; i < 32; i++) name[i] = word(thread, with + 8 * i);
                    printf("%.255s\t%lu\n", (char *)name, count);
                    fflush(stdout);
                }
                ptrace(PTRACE_SETREGS, thread, 0, &registers);
            } else if (is_stepping && thread == counted) {
                count++;
            }
        } else if (signal != SIGTRAP && signal != SIGSTOP) {
            passed_on = signal;
        }
        ptrace(is_stepping && thread == counted ? PTRACE_SINGLESTEP : PTRACE_CONT, thread, 0, (long)passed_on);
    }
    return 0;
}
