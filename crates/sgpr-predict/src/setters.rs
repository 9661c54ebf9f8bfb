//! Setters of structs that may have more fields later. A crate that derives them brings seven
//! others, and this one has few.

/// `with_FIELD(FIELD: KIND)`, each a method that sets a public field.
macro_rules! setters {
    ($($name:ident($field:ident: $kind:ty)),+ $(,)?) => {
        $(
            #[doc = concat!("The same with [`", stringify!($field), "`](Self#structfield.", stringify!($field), ") \
                 set.")]
            #[must_use]
            pub fn $name(mut self, $field: $kind) -> Self {
                self.$field = $field;
                self
            }
        )+
    };
}
