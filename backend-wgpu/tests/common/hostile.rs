//! Drivers that do what WGSL lets them do and no driver at hand does, modelled by rewriting the arithmetic of a shader.

#![allow(dead_code, reason = "each test uses a part")]

/// A driver: what it does, and the texts of `arithmetic.wgsl` that it replaces.
pub(crate) struct Driver {
    /// In words.
    pub(crate) name: &'static str,
    changes: &'static [[&'static str; 2]],
}

/// Free operations, as they stand in the text.
const FREE: [&str; 3] = ["    return a * b;\n", "    return a * b + c;\n", "    return a - b;\n"];
const GUARD: &str = "    return bitcast<f32>(bitcast<u32>(x) ^ opaque_zero);\n";
const RECIPROCAL: &str = "    return 1.0 / a;\n";

/// Drivers under which all results must stay as they are. WGSL allows reciprocals 2.5 units in the last place.
pub(crate) const ALLOWED: &[Driver] = &[
    Driver {
        name: "reciprocals are too large",
        changes: &[[RECIPROCAL, "    return bitcast<f32>(bitcast<u32>(1.0 / a) + 2u);\n"]],
    },
    Driver {
        name: "reciprocals are too small",
        changes: &[[RECIPROCAL, "    return bitcast<f32>(max(bitcast<u32>(1.0 / a), 2u) - 2u);\n"]],
    },
    Driver {
        name: "free operations round away from zero",
        changes: &[
            [
                FREE[0],
                "    let r = a * b; return select(r, bitcast<f32>(bitcast<u32>(r) + 1u), r != 0.0);\n",
            ],
            [
                FREE[1],
                "    let r = a * b + c; return select(r, bitcast<f32>(bitcast<u32>(r) + 1u), r != 0.0);\n",
            ],
            [
                FREE[2],
                "    let r = a - b; return select(r, bitcast<f32>(bitcast<u32>(r) + 1u), r != 0.0);\n",
            ],
        ],
    },
    Driver {
        name: "free operations round towards zero",
        changes: &[
            [
                FREE[0],
                "    let r = a * b; return select(r, bitcast<f32>(bitcast<u32>(r) - 1u), r != 0.0);\n",
            ],
            [
                FREE[1],
                "    let r = a * b + c; return select(r, bitcast<f32>(bitcast<u32>(r) - 1u), r != 0.0);\n",
            ],
            [
                FREE[2],
                "    let r = a - b; return select(r, bitcast<f32>(bitcast<u32>(r) - 1u), r != 0.0);\n",
            ],
        ],
    },
    Driver { name: "products and sums fuse", changes: &[[FREE[1], "    return fma(a, b, c);\n"]] },
    Driver {
        name: "subnormal results are flushed",
        changes: &[[
            GUARD,
            "    let r = bitcast<f32>(bitcast<u32>(x) ^ opaque_zero); return select(r, 0.0, abs(r) < LEAST_NORMAL);\n",
        ]],
    },
    Driver {
        name: "zeros lose their sign",
        changes: &[[
            GUARD,
            "    let r = bitcast<u32>(x) ^ opaque_zero; return bitcast<f32>(select(r, 0u, r == 0x80000000u));\n",
        ]],
    },
    Driver {
        name: "zeros become negative",
        changes: &[[
            GUARD,
            "    let r = bitcast<u32>(x) ^ opaque_zero; return bitcast<f32>(select(r, 0x80000000u, r == 0u));\n",
        ]],
    },
];

/// A driver that does what WGSL does not allow, and that a test of quotients must notice.
pub(crate) const FORBIDDEN: Driver = Driver {
    name: "reciprocals are wrong",
    changes: &[[RECIPROCAL, "    return bitcast<f32>(bitcast<u32>(1.0 / a) + 40u);\n"]],
};

impl Driver {
    /// A shader as this driver compiles it.
    ///
    /// # Panics
    /// If a text to replace is not there.
    pub(crate) fn compiled(&self, source: &str) -> String {
        let mut source = source.to_owned();
        for [right, changed] in self.changes {
            assert!(source.contains(right), "{}: the text is not there: {right}", self.name);
            source = source.replace(right, changed);
        }
        source
    }
}
