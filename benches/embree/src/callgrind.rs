//! Requests to callgrind, Valgrind's tool that counts: what is between them is counted. Outside of Valgrind they do
//! nothing. Numbers and instructions are those of Valgrind's `valgrind.h` and `callgrind.h`.

/// `VG_USERREQ__RUNNING_ON_VALGRIND`.
const RUNNING: usize = 0x1001;
/// `VG_USERREQ_TOOL_BASE('C', 'T')`, and what is added to it for each request.
const CALLGRIND: usize = 0x4354_0000;
const ZERO: usize = CALLGRIND + 1;
const TOGGLE: usize = CALLGRIND + 2;
const DUMP: usize = CALLGRIND + 3;
const START: usize = CALLGRIND + 4;
const STOP: usize = CALLGRIND + 5;

/// Whether the program runs under Valgrind.
pub(crate) fn is_here() -> bool {
    request(RUNNING, 0) != 0
}

/// Does some work twice: the first time the simulated caches and branches get to know it, the second time it is counted. The
/// counts are written to a file of callgrind's that has `name` as its trigger. What `ready` does before each is not counted.
pub(crate) fn count(name: &str, mut ready: impl FnMut(), mut work: impl FnMut()) {
    let name: Vec<u8> = name.bytes().chain([0]).collect();
    ready();
    request(START, 0);
    work();
    ready();
    request(ZERO, 0);
    request(TOGGLE, 0);
    work();
    request(TOGGLE, 0);
    request(DUMP, name.as_ptr() as usize);
    request(STOP, 0);
}

/// What Valgrind answers; 0 without it.
#[cfg(all(target_arch = "x86_64", unix))]
fn request(what: usize, with: usize) -> usize {
    let arguments = [what, with, 0, 0, 0, 0];
    let mut answer = 0usize;
    // SAFETY: a processor turns `rdi` by 128 bits in all and exchanges a register with itself; Valgrind reads six words, and the text
    // that one of them may point to.
    unsafe {
        std::arch::asm!(
            "rol rdi, 3",
            "rol rdi, 13",
            "rol rdi, 61",
            "rol rdi, 51",
            "xchg rbx, rbx",
            in("rax") arguments.as_ptr(),
            inout("rdx") answer,
            options(nostack),
        );
    }
    answer
}

/// No Valgrind.
#[cfg(not(all(target_arch = "x86_64", unix)))]
fn request(_: usize, _: usize) -> usize {
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_valgrind_the_work_is_done_twice_and_nothing_else() {
        let mut done = 0;
        let mut made_ready = 0;
        count("work", || made_ready += 1, || done += 1);
        assert_eq!((done, made_ready, is_here()), (2, 2, false));
    }
}
