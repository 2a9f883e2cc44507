use super::*;

#[test]
fn bindings_fit_the_default_limits_and_name_no_buffer_twice() {
    for kernel in Kernel::ALL {
        let bindings: [Option<Slot<TreeBuilder>>; 12] = {
            let mut slots = TreeBuilder::slots(kernel);
            core::array::from_fn(|_| slots.next())
        };
        // The parameters, and WebGPU's default of eight storage buffers.
        assert!(bindings.iter().flatten().count() <= 1 + 8, "{kernel:?}");
        for (i, a) in bindings.iter().flatten().enumerate() {
            let mut before = bindings.iter().flatten().take(i);
            let same = |b: &Slot<TreeBuilder>| match (a, b) {
                (Slot::Storage(a), Slot::Storage(b)) => a.buffer == b.buffer,
                _ => a == b,
            };
            assert!(!before.any(same), "{kernel:?}");
        }
        for (i, a) in kernel.bindings().enumerate() {
            assert!(kernel.bindings().take(i).all(|b| b.buffer != a.buffer), "{kernel:?}");
        }
    }
}

/// Rows are found by number.
fn stands_in_order<K: KernelSet>() {
    for (index, row) in K::KERNELS.iter().enumerate() {
        assert_eq!(K::kernel_index(row.kernel), index, "{}", row.name);
    }
    for (index, row) in K::BUFFERS.iter().enumerate() {
        assert_eq!(K::buffer_index(row.buffer), index, "{}", row.name);
    }
}

#[test]
fn rows_stand_at_their_numbers() {
    stands_in_order::<TreeBuilder>();
    stands_in_order::<RayQueries>();
    stands_in_order::<DeviceChecks>();
}

fn storage(buffer: Buffer, access: Access) -> Slot<TreeBuilder> {
    Slot::Storage(Binding { buffer, access })
}

/// Parameters and counters come first, counters as the kernel's row says; buffers that share a
/// storage are bound once, in the place of the first of them, with all their accesses.
#[test]
fn slots_follow_from_the_table() {
    use Access::{Read, ReadWrite, Scatter, Write};
    let parameters = Slot::Uniform(Uniform::Parameters);
    assert!(TreeBuilder::slots(Kernel::ScatterReferences).eq([
        parameters,
        storage(Buffer::Counters, Read),
        storage(Buffer::Chunks, Read),
        storage(Buffer::Decisions, Read),
        storage(Buffer::References, Read),
        storage(Buffer::Triangles, Read),
        storage(Buffer::ChunkState, ReadWrite),
        storage(Buffer::NextReferences, Write),
        storage(Buffer::SmallReferences, Scatter),
    ]));
    assert!(TreeBuilder::slots(Kernel::PreorderAddresses).eq([
        parameters,
        storage(Buffer::Counters, ReadWrite),
        storage(Buffer::TopParents, Read),
        storage(Buffer::TopSizes, Read),
        storage(Buffer::TopAddresses, Write),
    ]));
    let scan = [storage(Buffer::Counters, ReadWrite), storage(Buffer::ChunkState, ReadWrite)];
    assert!(TreeBuilder::slots(Kernel::ScanTriangles).skip(1).take(2).eq(scan));
    // Written by the table of the queries: uniforms between buffers.
    let places: [Option<Slot<RayQueries>>; 8] = {
        let mut slots = RayQueries::slots(QueryKernel::ClosestHit);
        core::array::from_fn(|_| slots.next())
    };
    assert_eq!(places[3], Some(Slot::Uniform(QueryUniform::Scene)));
    assert_eq!(places[6], Some(Slot::Uniform(QueryUniform::Batch)));
    let deferred = Binding { buffer: QueryBuffer::Deferred, access: ReadWrite };
    assert_eq!(places[7], Some(Slot::Storage(deferred)));
}

#[test]
fn counters_are_written_by_those_that_say_so() {
    for kernel in Kernel::ALL {
        let mut counters = false;
        TreeBuilder::written(kernel, &mut |buffer| counters |= buffer == Buffer::Counters);
        let expected = matches!(
            kernel,
            Kernel::ScanTriangles
                | Kernel::AllocateChildren
                | Kernel::ScanMiddle
                | Kernel::PreorderAddresses
        );
        assert_eq!(counters, expected, "{kernel:?}");
    }
}

#[test]
fn lists_change_places_in_pairs() {
    for row in TreeBuilder::BUFFERS {
        let other = TreeBuilder::exchanged(row.buffer);
        assert_eq!(TreeBuilder::exchanged(other), row.buffer);
        assert_eq!(other.element_size(), row.element_size, "{}", row.name);
    }
    assert_eq!(TreeBuilder::exchanged(Buffer::NextReferences), Buffer::References);
    assert_eq!(TreeBuilder::exchanged(Buffer::Nodes), Buffer::Nodes);
}
