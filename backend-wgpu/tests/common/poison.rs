//! Shaders whose workgroups start with their memory full of some word, as they may on a device that clears nothing.

/// Words to fill memory with: one that no kernel expects, and one that it may.
pub(crate) const WORDS: [u32; 2] = [0xdead_beef, 1];

/// The shader, if it has memory of a workgroup, with every variable there set to `word` before anything else runs.
///
/// # Panics
/// If the text has a type that this does not know, or no entry point with its index in the workgroup.
pub(crate) fn poisoned(source: &str, word: u32) -> Option<String> {
    let stores: Vec<String> = source
        .lines()
        .filter_map(|line| line.strip_prefix("var<workgroup> "))
        .map(|variable| {
            let (name, kind) = variable.trim_end_matches(';').split_once(": ").expect("a type");
            store(source, name, kind, word)
        })
        .collect();
    if stores.is_empty() {
        return None;
    }
    let main = source.find("fn main(").expect("an entry point");
    let index = "@builtin(local_invocation_index) ";
    let lane = &source[main + source[main..].find(index).expect("an index") + index.len()..];
    let lane = &lane[..lane.find(':').expect("its type")];
    let body = main + source[main..].find("{\n").expect("a body") + 2;
    let call = format!("    if {lane} == 0u {{ poison(); }}\n    workgroupBarrier();\n");
    let stores = stores.concat();
    let (head, rest) = source.split_at(body);
    Some(format!("{head}{call}{rest}\nfn poison() {{\n{stores}}}\n"))
}

/// Type and length of an array.
fn array(kind: &str) -> Option<(&str, &str)> {
    kind.strip_prefix("array<")?.strip_suffix('>')?.rsplit_once(", ")
}

fn store(source: &str, name: &str, kind: &str, word: u32) -> String {
    if let Some((element, length)) = array(kind) {
        let inner = store(source, &format!("{name}[i]"), element, word);
        return format!("    for (var i = 0u; i < {length}; i++) {{\n    {inner}    }}\n");
    }
    if kind == "atomic<u32>" {
        return format!("    atomicStore(&{name}, {word}u);\n");
    }
    format!("    {name} = {};\n", value(source, kind, word))
}

/// A value of a type, all words of which are `word`.
fn value(source: &str, kind: &str, word: u32) -> String {
    if let Some((element, length)) = array(kind) {
        let length = length.trim_end_matches('u').parse().expect("a number");
        let values = vec![value(source, element, word); length];
        return format!("{kind}({})", values.join(", "));
    }
    if let Some(element) = kind.strip_prefix("vec").and_then(|rest| rest[1..].strip_prefix('<')) {
        return format!("{kind}({})", value(source, element.trim_end_matches('>'), word));
    }
    match kind {
        "u32" => format!("{word}u"),
        "i32" => format!("bitcast<i32>({word}u)"),
        "f32" => format!("bitcast<f32>({word}u)"),
        "bool" => "true".into(),
        _ => {
            let start = format!("struct {kind} {{\n");
            let fields = &source[source.find(&start).expect("a struct") + start.len()..];
            let fields: Vec<String> = fields[..fields.find('}').expect("its end")]
                .lines()
                .map(|line| line.trim())
                .filter(|line| !line.is_empty() && !line.starts_with("//"))
                .map(|line| line.split_once(": ").expect("a field").1.trim_end_matches(','))
                .map(|kind| value(source, kind, word))
                .collect();
            format!("{kind}({})", fields.join(", "))
        }
    }
}
