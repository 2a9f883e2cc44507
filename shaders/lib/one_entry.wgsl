// An invocation takes one entry of a list. In place of strided.wgsl where there are as many invocations as entries, as on software: SwiftShader
// takes more than 40 seconds for a traversal within one loop more, and less than 3 for the traversal.
fn take_entries(first: u32, count: u32, apart: u32) {
    if first < count {
        take_entry(first);
    }
}
