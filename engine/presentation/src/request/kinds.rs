//! The kinds that a study may use: those of this crate, and those that other crates registered.

use crate::{
    figure::{self, Figure},
    kinds::{Kind, KindSpec, Readable},
    table::{self, Table},
};
use contract::Registry;

/// The kinds of tables and figures that a study may use.
pub struct Kinds {
    /// Kinds of tables, those of the engine first.
    pub tables: Vec<Readable<dyn Table>>,
    /// Kinds of figures, those of the engine first.
    pub figures: Vec<Readable<dyn Figure>>,
}

impl Default for Kinds {
    /// The kinds of the engine.
    fn default() -> Self {
        Self {
            tables: table::kinds(),
            figures: figure::kinds(),
        }
    }
}

impl Kinds {
    /// The kinds of the engine and those that other crates registered.
    #[must_use]
    pub fn of(registry: &Registry) -> Self {
        let mut all = Self::default();
        all.tables.extend(registry.extensions::<Readable<dyn Table>>());
        all.figures.extend(registry.extensions::<Readable<dyn Figure>>());
        all
    }

    /// Facts on the kinds of tables.
    #[must_use]
    pub fn of_tables(&self) -> Vec<Kind> {
        self.tables.iter().map(|it| it.kind).collect()
    }

    /// Facts on the kinds of figures.
    #[must_use]
    pub fn of_figures(&self) -> Vec<Kind> {
        self.figures.iter().map(|it| it.kind).collect()
    }
}

/// Registration of kinds of tables and figures.
pub trait RegisterKinds {
    /// Registers a kind of tables.
    ///
    /// # Panics
    /// If the name is taken: a mistake in the program, found by every test.
    fn table<T: Table + KindSpec>(&mut self);

    /// Registers a kind of figures.
    ///
    /// # Panics
    /// If the name is taken: a mistake in the program, found by every test.
    fn figure<F: Figure + KindSpec>(&mut self);
}

impl RegisterKinds for Registry {
    fn table<T: Table + KindSpec>(&mut self) {
        let taken = Kinds::of(self).of_tables();
        enter(self, table::kind::<T>(), &taken);
    }

    fn figure<F: Figure + KindSpec>(&mut self) {
        let taken = Kinds::of(self).of_figures();
        enter(self, figure::kind::<F>(), &taken);
    }
}

fn enter<T: ?Sized + 'static>(registry: &mut Registry, entry: Readable<T>, taken: &[Kind]) {
    let name = entry.kind.name;
    assert!(
        taken.iter().all(|kind| kind.name != name),
        "the kind `{name}` is registered twice"
    );
    registry.extend(entry);
}
