// The lists that references are moved between, where one binding does not hold a list: a dispatch sees one half of
// the references, and one half of one list of children, in the binding `next_references`. All dispatches
// together do what one does over whole lists (children.wgsl). A chunk is worked on wherever some of its node's
// references may be stored, and its bounds come out the same each time.
// Needs the bindings `references` and `next_references`.

// Whether the dispatch stores references of small roots, and which half.
fn stores_small() -> bool {
    return (parameters.view & 4u) != 0u;
}

fn first_stored() -> u32 {
    let half = select(parameters.reference_half, parameters.small_reference_half, stores_small());
    return select(0u, half, (parameters.view & 2u) != 0u);
}

fn end_stored() -> u32 {
    let half = select(parameters.reference_half, parameters.small_reference_half, stores_small());
    return select(half, 0xffffffffu, (parameters.view & 2u) != 0u);
}

// Whether some of a child's `count` references from `first` on are stored.
fn stores_some(first: u32, count: u32) -> bool {
    let small = count <= parameters.hand_over_limit;
    return small == stores_small() && first < end_stored() && first + count > first_stored();
}

// Whether a chunk is of those that a dispatch works on. The reads of a chunk may reach beyond the half that it
// begins in: the binding does so too.
fn is_seen(chunk: Chunk, decision: Decision) -> bool {
    let second = chunk.first >= parameters.reference_half;
    if second != ((parameters.view & 1u) != 0u) {
        return false;
    }
    if decision.axis == TRANSFER {
        let end = decision.first.x + decision.counts.x;
        return stores_small() && decision.first.x < end_stored() && end > first_stored();
    }
    // Of what goes nowhere only the bounds are written.
    let nowhere = decision.counts.x + decision.counts.y == 0u && (parameters.view & 6u) == 0u;
    return nowhere || stores_some(decision.first.x, decision.counts.x)
        || stores_some(decision.first.y, decision.counts.y);
}

fn active_reference(place: u32) -> Reference {
    return references[place - select(0u, parameters.reference_half, (parameters.view & 1u) != 0u)];
}

fn store_if_seen(place: u32, reference: Reference) {
    if place >= first_stored() && place < end_stored() {
        next_references[place - first_stored()] = reference;
    }
}

fn store_next(place: u32, reference: Reference) {
    if !stores_small() {
        store_if_seen(place, reference);
    }
}

fn store_small(place: u32, reference: Reference) {
    if stores_small() {
        store_if_seen(place, reference);
    }
}
