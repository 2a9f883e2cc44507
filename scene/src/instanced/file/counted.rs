//! Reads JSON values that may be large under a budget: what a value takes is counted before it is stored.

use crate::budget::{Budget, Full};
use serde::de::{Deserialize, DeserializeSeed, Deserializer, Error, SeqAccess, Visitor};
use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

/// A value that takes more than its own bytes, such as a list.
pub(super) trait Counted<'de>: Sized {
    fn read<D: Deserializer<'de>>(from: D, budget: &Budget) -> Result<Self, D::Error>;
}

/// A value that takes nothing beside its own bytes.
pub(super) fn plain<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    from: D,
    _: &Budget,
) -> Result<T, D::Error> {
    T::deserialize(from)
}

/// An error that says little: the budget knows more, and is asked.
pub(super) fn full<E: Error>(_: Full) -> E {
    E::custom("there is no memory for it")
}

/// Text is borrowed where the file has it as it is.
impl<'de> Counted<'de> for Cow<'de, str> {
    fn read<D: Deserializer<'de>>(from: D, budget: &Budget) -> Result<Self, D::Error> {
        struct Text<'b>(&'b Budget);
        impl<'de> Visitor<'de> for Text<'_> {
            type Value = Cow<'de, str>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a string")
            }

            fn visit_borrowed_str<E: Error>(self, text: &'de str) -> Result<Self::Value, E> {
                Ok(Cow::Borrowed(text))
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
                self.0.copied(text).map(Cow::Owned).map_err(full)
            }
        }
        from.deserialize_str(Text(budget))
    }
}

/// `null` is as nothing.
impl<'de, T: Counted<'de>> Counted<'de> for Option<T> {
    fn read<D: Deserializer<'de>>(from: D, budget: &Budget) -> Result<Self, D::Error> {
        struct Perhaps<'b, T>(&'b Budget, PhantomData<T>);
        impl<'de, T: Counted<'de>> Visitor<'de> for Perhaps<'_, T> {
            type Value = Option<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("option")
            }

            fn visit_none<E: Error>(self) -> Result<Self::Value, E> {
                Ok(None)
            }

            fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
                Ok(None)
            }

            fn visit_some<D: Deserializer<'de>>(self, from: D) -> Result<Self::Value, D::Error> {
                T::read(from, self.0).map(Some)
            }
        }
        from.deserialize_option(Perhaps(budget, PhantomData))
    }
}

/// A value that few entries have.
impl<'de, T: Deserialize<'de>> Counted<'de> for Box<T> {
    fn read<D: Deserializer<'de>>(from: D, budget: &Budget) -> Result<Self, D::Error> {
        budget.take(size_of::<T>() as u64).map_err(full)?;
        T::deserialize(from).map(Box::new)
    }
}

/// Each entry has its place before it is read, so that none is stored beyond the limit.
impl<'de, T: Counted<'de>> Counted<'de> for Vec<T> {
    fn read<D: Deserializer<'de>>(from: D, budget: &Budget) -> Result<Self, D::Error> {
        struct All<'b, T>(&'b Budget, PhantomData<T>);
        impl<'de, T: Counted<'de>> Visitor<'de> for All<'_, T> {
            type Value = Vec<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a sequence")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
                let mut list = Vec::new();
                while entries.next_element_seed(Push(self.0, &mut list))?.is_some() {}
                Ok(list)
            }
        }
        from.deserialize_seq(All(budget, PhantomData))
    }
}

/// Reads an entry into a list.
struct Push<'a, T>(&'a Budget, &'a mut Vec<T>);

impl<'de, T: Counted<'de>> DeserializeSeed<'de> for Push<'_, T> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        self.0.grow(self.1, 1).map_err(full)?;
        self.1.push(T::read(from, self.0)?);
        Ok(())
    }
}

/// The name of a field, as one of those that there are.
pub(super) struct FieldName(pub(super) &'static [&'static str]);

impl<'de> DeserializeSeed<'de> for FieldName {
    type Value = &'static str;

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<&'static str, D::Error> {
        from.deserialize_identifier(self)
    }
}

impl Visitor<'_> for FieldName {
    type Value = &'static str;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("field identifier")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<&'static str, E> {
        let known = self.0.iter().find(|own| **own == name);
        known.copied().ok_or_else(|| E::unknown_field(name, self.0))
    }
}

/// An object whose fields may be large: the struct, and how it is read. Each field has the function that reads it, and what stands for it where it is left out: `or` everywhere, `else` in objects
/// alone, not at the end of a list of values without names.
macro_rules! object {
    ($(#[$about:meta])* $name:ident $([$own:lifetime])? of $life:lifetime {
        $($field:ident: $type:ty = $read:path $(, or $missing:expr)? $(, else $absent:expr)?;)*
    }) => {
        $(#[$about])*
        pub(super) struct $name $(<$own>)? {
            $(pub(super) $field: $type,)*
        }

        impl<$life> Counted<$life> for $name $(<$own>)? {
            fn read<D: Deserializer<$life>>(from: D, budget: &Budget) -> Result<Self, D::Error> {
                const FIELDS: &[&str] = &[$(stringify!($field)),*];
                struct Fields<'b>(&'b Budget);
                impl<$life> Visitor<$life> for Fields<'_> {
                    type Value = $name $(<$own>)?;

                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str(concat!("struct ", stringify!($name)))
                    }

                    fn visit_map<A: MapAccess<$life>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                        $(let mut $field: Option<$type> = None;)*
                        while let Some(name) = map.next_key_seed(FieldName(FIELDS))? {
                            $(if name == stringify!($field) {
                                if $field.is_some() {
                                    return Err(A::Error::duplicate_field(stringify!($field)));
                                }
                                let seed = object!(@seed $life, $type, $read, self.0);
                                $field = Some(map.next_value_seed(seed)?);
                                continue;
                            })*
                        }
                        Ok($name {
                            $($field: match $field {
                                Some(value) => value,
                                None => object!(@missing $field $(, $missing)? $(, $absent)?),
                            },)*
                        })
                    }

                    // The values of its fields in their order, without names.
                    fn visit_seq<A: SeqAccess<$life>>(self, mut all: A) -> Result<Self::Value, A::Error> {
                        $(
                            let seed = object!(@seed $life, $type, $read, self.0);
                            let $field = all.next_element_seed(seed)?;
                        )*
                        Ok($name {
                            $($field: match $field {
                                Some(value) => value,
                                None => object!(@missing $field $(, $missing)?),
                            },)*
                        })
                    }
                }
                from.deserialize_struct(stringify!($name), FIELDS, Fields(budget))
            }
        }
    };
    (@seed $life:lifetime, $type:ty, $read:path, $budget:expr) => {{
        struct Seed<'b>(&'b Budget);
        impl<$life> DeserializeSeed<$life> for Seed<'_> {
            type Value = $type;

            fn deserialize<D: Deserializer<$life>>(self, from: D) -> Result<$type, D::Error> {
                $read(from, self.0)
            }
        }
        Seed($budget)
    }};
    (@missing $field:ident) => {
        return Err(A::Error::missing_field(stringify!($field)))
    };
    (@missing $field:ident, $missing:expr) => {
        $missing
    };
}
pub(super) use object;
