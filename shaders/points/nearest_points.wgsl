// The nearest points of each query of a batch, up to 16.
// One invocation a query.
// Reads: the tree, its points and their indices; which of them count; the queries.
// Writes: their keys, in no order.
// Ties: the lower index.

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    opaque_zero = point_batch.zero;
    own_lane = local;
    let index = query_index(workgroup, workgroups, local);
    if index >= point_batch.count {
        return;
    }
    begin_list(index);
    let done = walk_points(queries[index]);
    end_list(index);
    if !done {
        mark_list(index);
    }
}
