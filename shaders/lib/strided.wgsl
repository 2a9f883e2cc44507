// A kernel for the entries of a list: an invocation takes every so many-th, so that few workgroups serve a list of any length.
// The kernel has `take_entry`.
fn take_entries(first: u32, count: u32, apart: u32) {
    for (var place = first; place < count; place += apart) {
        take_entry(place);
    }
}
