// The lists that references are moved between, each in one binding: see children_by_halves.wgsl for lists that are
// too long for that. Needs the bindings `references` and `next_references`.

@group(0) @binding(8) var<storage, read_write> small_references: array<Reference>;

// Whether a chunk is of those that a dispatch works on.
fn is_seen(chunk: Chunk, decision: Decision) -> bool {
    return true;
}

fn active_reference(place: u32) -> Reference {
    return references[place];
}

fn store_next(place: u32, reference: Reference) {
    next_references[place] = reference;
}

fn store_small(place: u32, reference: Reference) {
    small_references[place] = reference;
}
