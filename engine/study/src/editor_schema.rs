//! The schema of a study for editors. `check` sees a study after includes and blocks were inserted. An editor sees the
//! text: any mapping may take blocks with `<<` and so lack a required key, and any key may have no value, which removes
//! the included one.

use serde_json::{Map, Value, json};

/// Name of the definition of the value of `<<`.
const TAKEN: &str = "taken_blocks";

/// The schema with `<<` in every mapping that may have keys.
#[must_use]
pub fn for_editors(mut schema: Value) -> Value {
    loosen(&mut schema);
    // A key that a study lacks may also be in a file that it includes.
    if let Some(Value::Array(ways)) = schema.pointer_mut("/allOf/0/anyOf") {
        ways.push(json!({ "required": ["include"] }));
    }
    schema["$defs"][TAKEN] = json!({
        "description": "Blocks whose keys stand here; keys beside win.",
        "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" } }, { "type": "object" }],
    });
    schema
}

/// Loosens a schema and everything below it.
fn loosen(schema: &mut Value) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(loosen),
        Value::Object(keys) => {
            for (_, below) in keys.iter_mut().filter(|(key, _)| *key != "x-example") {
                loosen(below);
            }
            // A value with keys from a block may fit none or several of the variants.
            if let Some(variants) = keys.remove("oneOf") {
                keys.insert("anyOf".into(), variants);
            }
            if is_mapping(keys) {
                allow_nothing(keys);
                take(keys);
            }
        }
        _ => {}
    }
}

/// Whether this is the schema of a mapping; false for a mapping of schemas.
fn is_mapping(keys: &Map<String, Value>) -> bool {
    keys.get("type") == Some(&json!("object"))
}

/// Allows keys of a mapping without a value.
fn allow_nothing(keys: &mut Map<String, Value>) {
    let named = keys.get_mut("properties").and_then(Value::as_object_mut);
    named.into_iter().flat_map(Map::values_mut).for_each(or_nothing);
    keys.get_mut("additionalProperties")
        .into_iter()
        .for_each(or_nothing);
}

/// Allows `null` beside what a schema allows.
fn or_nothing(schema: &mut Value) {
    let Some(keys) = schema.as_object_mut().filter(|keys| !keys.is_empty()) else {
        return;
    };
    let nothing = json!({ "type": "null" });
    if let Some(Value::Array(ways)) = keys.get_mut("anyOf") {
        ways.push(nothing);
        return;
    }
    // The description of a key stays at the level where editors look for it.
    let shown = ["description", "default"];
    let mut around: Map<String, Value> = shown
        .into_iter()
        .filter_map(|key| Some((key.to_owned(), keys.remove(key)?)))
        .collect();
    around.insert("anyOf".into(), json!([std::mem::take(keys), nothing]));
    *schema = around.into();
}

/// Allows `<<` in a mapping; the block may contain the required keys.
fn take(keys: &mut Map<String, Value>) {
    let taken = json!({ "$ref": format!("#/$defs/{TAKEN}") });
    let properties = keys.entry("properties").or_insert_with(|| json!({}));
    properties["<<"] = taken;
    if let Some(required) = keys.remove("required") {
        let ways = json!([{ "required": required }, { "required": ["<<"] }]);
        keys.insert("allOf".into(), json!([{ "anyOf": ways }]));
    }
    if let Some(most) = keys.get("maxProperties").and_then(Value::as_u64) {
        keys.insert("maxProperties".into(), json!(most + 1));
    }
    if let Some(least) = keys.get("minProperties").and_then(Value::as_u64) {
        keys.insert("minProperties".into(), json!(least.min(1)));
    }
    if let Some(names) = keys.remove("propertyNames") {
        keys.insert(
            "propertyNames".into(),
            json!({ "anyOf": [names, { "const": "<<" }] }),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_mapping_may_take_blocks_in_place_of_what_it_needs() {
        let strict = json!({
            "type": "object", "required": ["study"], "additionalProperties": false,
            "properties": {
                "study": { "type": "string", "description": "Its name." },
                "agents": { "type": "object", "minProperties": 2, "maxProperties": 2,
                    "propertyNames": { "pattern": "^a" }, "additionalProperties": { "oneOf": [{ "const": 1 }] } },
            },
        });
        let loose = for_editors(strict);
        let taken = json!({ "$ref": "#/$defs/taken_blocks" });
        assert_eq!(loose.pointer("/properties/<<"), Some(&taken));
        assert_eq!(
            loose["allOf"],
            json!([{ "anyOf": [{ "required": ["study"] }, { "required": ["<<"] }, { "required": ["include"] }] }])
        );
        let nothing = json!({ "type": "null" });
        assert_eq!(
            loose["properties"]["study"],
            json!({ "description": "Its name.", "anyOf": [{ "type": "string" }, nothing] })
        );
        let agents = &loose["properties"]["agents"]["anyOf"][0];
        assert_eq!(
            (&agents["minProperties"], &agents["maxProperties"]),
            (&json!(1), &json!(3))
        );
        assert_eq!(
            agents["propertyNames"],
            json!({ "anyOf": [{ "pattern": "^a" }, { "const": "<<" }] })
        );
        assert_eq!(
            agents["additionalProperties"],
            json!({ "anyOf": [{ "const": 1 }, nothing] })
        );
        assert!(loose.get("required").is_none() && loose["additionalProperties"] == json!(false));
    }
}
