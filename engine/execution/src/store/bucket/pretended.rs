//! A bucket in memory, for tests.

use super::{
    Bucket,
    objects::{Object, Objects, WriteCondition},
};
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex},
};

#[derive(Debug, Default)]
struct MemoryObjects(Mutex<BTreeMap<String, Vec<u8>>>);

fn tag(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

impl Objects for MemoryObjects {
    fn get(&self, key: &str) -> Result<Option<Object>, String> {
        let found = self.0.lock().unwrap().get(key).cloned();
        Ok(found.map(|bytes| Object {
            tag: tag(&bytes),
            bytes,
        }))
    }

    fn put(&self, key: &str, bytes: &[u8], when: WriteCondition<'_>) -> Result<bool, String> {
        let mut all = self.0.lock().unwrap();
        let there = all.get(key).map(|bytes| tag(bytes));
        let holds = match when {
            WriteCondition::Always => true,
            WriteCondition::New => there.is_none(),
            WriteCondition::Unchanged(tag) => there.as_deref() == Some(tag),
        };
        if holds {
            all.insert(key.to_owned(), bytes.to_vec());
        }
        Ok(holds)
    }

    fn delete(&self, key: &str) -> Result<(), String> {
        self.0.lock().unwrap().remove(key);
        Ok(())
    }

    fn list(&self, prefix: &str) -> Result<Vec<String>, String> {
        let all = self.0.lock().unwrap();
        Ok(all
            .keys()
            .filter(|key| key.starts_with(prefix))
            .cloned()
            .collect())
    }
}

/// An empty bucket.
pub(super) fn bucket() -> Bucket {
    Bucket {
        address: "s3://pretended".into(),
        objects: Arc::new(MemoryObjects::default()),
    }
}
