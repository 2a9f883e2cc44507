// A thread with a planted fault: its compiled part fails when it first asks for the time, which it does to tell of progress.

Date.now = () => {
    throw new Error("planted");
};
await import("/js/threads-worker.js");
