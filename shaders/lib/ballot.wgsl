// One bit of each of 256 lanes, for two questions at a time. Bits are gathered by atomic OR, whose
// result does not depend on order.

var<workgroup> ballot_words: array<atomic<u32>, 16>;

// Asks all lanes; every lane must call it. Words 0 to 7 hold the first answers, 8 to 15 the second.
fn ballot(lane: u32, first: bool, second: bool) {
    workgroupBarrier();
    if lane < 16u {
        atomicStore(&ballot_words[lane], 0u);
    }
    workgroupBarrier();
    if first {
        atomicOr(&ballot_words[lane / 32u], 1u << (lane % 32u));
    }
    if second {
        atomicOr(&ballot_words[8u + lane / 32u], 1u << (lane % 32u));
    }
    workgroupBarrier();
}

// How many lanes answered yes to question 0 or 1.
fn ballot_count(question: u32) -> u32 {
    var count = 0u;
    for (var word = 0u; word < 8u; word++) {
        count += countOneBits(atomicLoad(&ballot_words[8u * question + word]));
    }
    return count;
}

// How many lanes before this one did.
fn ballot_rank(question: u32, lane: u32) -> u32 {
    var count = 0u;
    for (var word = 0u; word < lane / 32u; word++) {
        count += countOneBits(atomicLoad(&ballot_words[8u * question + word]));
    }
    let last = atomicLoad(&ballot_words[8u * question + lane / 32u]);
    return count + countOneBits(last & ((1u << (lane % 32u)) - 1u));
}
