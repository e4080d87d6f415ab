//! Object storage over HTTP: Amazon's S3, and every service with the same protocol.

use contract::Registry;
use execution::{
    store::{Object, ObjectStorage, Objects, RegisterObjectStorage, WriteCondition},
    world::clock,
};
use rusty_s3::{
    Credentials, UrlStyle,
    actions::{DeleteObject, GetObject, ListObjectsV2, PutObject, S3Action},
};
use std::{sync::Arc, time::Duration};
use ureq::{
    Agent, Body,
    http::{Response, StatusCode},
};

/// Time for which the signature of a request holds.
const SIGNED_FOR: Duration = Duration::from_secs(900);
/// Longest time until a connection is made, and until an answer begins.
const PATIENCE: Duration = Duration::from_secs(30);
/// Longest time of the transfer of an object.
const LONGEST_WAY: Duration = Duration::from_secs(600);
/// Number of attempts at a request that gets no answer or one that says `later`.
const ATTEMPTS: u32 = 6;
/// The wait before the second attempt; it doubles.
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// Longest part of an answer that is shown.
const SHOWN: usize = 300;

/// Registers the object storage of this crate.
pub fn register(registry: &mut Registry) {
    registry.object_storage(ObjectStorage {
        open: |address, variable| Ok(Arc::new(Service::at(address, variable)?)),
    });
}

/// Part of a bucket at a service.
struct Service {
    agent: Agent,
    bucket: rusty_s3::Bucket,
    credentials: Credentials,
    /// Prefix of keys: empty, or with a slash at its end.
    prefix: String,
}

impl std::fmt::Debug for Service {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Keys are not shown.
        write!(f, "s3://{}/{}", self.bucket.name(), self.prefix)
    }
}

/// Name of the bucket and prefix.
fn parts(address: &str) -> Result<(&str, String), String> {
    let rest = address
        .strip_prefix("s3://")
        .ok_or("an address is `s3://bucket/prefix`")?;
    let (name, prefix) = rest.split_once('/').unwrap_or((rest, ""));
    if name.is_empty() {
        return Err("an address is `s3://bucket/prefix`, and here no bucket is named".into());
    }
    let prefix = prefix.trim_matches('/');
    let end = if prefix.is_empty() { "" } else { "/" };
    Ok((name, format!("{prefix}{end}")))
}

impl Service {
    /// The bucket at an address such as `s3://name/prefix`. Keys, region and endpoint have the names that other programs
    /// use (`AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_SESSION_TOKEN`, `AWS_REGION`, `AWS_ENDPOINT_URL`).
    fn at(address: &str, variable: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let (name, prefix) = parts(address)?;
        let some = |names: &[&str]| {
            names
                .iter()
                .find_map(|name| variable(name).filter(|value| !value.is_empty()))
        };
        let needed = |name: &str| {
            some(&[name]).ok_or_else(|| format!("set {name}, as for other programs that use S3"))
        };
        let (key, secret) = (needed("AWS_ACCESS_KEY_ID")?, needed("AWS_SECRET_ACCESS_KEY")?);
        let credentials = match some(&["AWS_SESSION_TOKEN"]) {
            Some(token) => Credentials::new_with_token(key, secret, token),
            None => Credentials::new(key, secret),
        };
        let region = some(&["AWS_REGION", "AWS_DEFAULT_REGION"]).unwrap_or_else(|| "us-east-1".into());
        let (endpoint, style) = match some(&["AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"]) {
            Some(url) => (url, UrlStyle::Path),
            None => (
                format!("https://s3.{region}.amazonaws.com"),
                UrlStyle::VirtualHost,
            ),
        };
        let url = endpoint
            .parse()
            .map_err(|error| format!("AWS_ENDPOINT_URL is `{endpoint}`: {error}"))?;
        let bucket = rusty_s3::Bucket::new(url, style, name.to_owned(), region)
            .map_err(|error| format!("AWS_ENDPOINT_URL is `{endpoint}`: {error}"))?;
        let agent = Agent::config_builder()
            .http_status_as_error(false)
            .timeout_connect(Some(PATIENCE))
            .timeout_resolve(Some(PATIENCE))
            .timeout_send_request(Some(PATIENCE))
            .timeout_send_body(Some(LONGEST_WAY))
            .timeout_recv_response(Some(PATIENCE))
            .timeout_recv_body(Some(LONGEST_WAY))
            .build()
            .into();
        Ok(Self {
            agent,
            bucket,
            credentials,
            prefix,
        })
    }

    fn key(&self, key: &str) -> String {
        format!("{}{key}", self.prefix)
    }
}

/// An answer: its status, its tag and its content.
struct Answer {
    status: StatusCode,
    tag: String,
    bytes: Vec<u8>,
}

impl Answer {
    fn read(mut response: Response<Body>) -> Result<Self, ureq::Error> {
        let tag = response.headers().get("etag").and_then(|tag| tag.to_str().ok());
        Ok(Self {
            status: response.status(),
            tag: tag.unwrap_or_default().to_owned(),
            bytes: response.body_mut().with_config().limit(u64::MAX).read_to_vec()?,
        })
    }

    /// Whether another attempt may have another answer.
    fn is_passing(&self) -> bool {
        // 409 is the answer to a conditional write that met another one.
        self.status.is_server_error() || matches!(self.status.as_u16(), 408 | 409 | 429)
    }

    fn refused<T>(&self) -> Result<T, String> {
        if says(self, "NoSuchBucket") {
            return Err("the service has no bucket of this name (NoSuchBucket): make it first".into());
        }
        let text = String::from_utf8_lossy(&self.bytes);
        let shown: String = text
            .chars()
            .filter(|letter| !letter.is_control())
            .take(SHOWN)
            .collect();
        Err(format!("the service answers {}: {shown}", self.status))
    }
}

/// Makes a request until it is answered.
fn answered(request: impl Fn() -> Result<Response<Body>, ureq::Error>) -> Result<Answer, String> {
    let attempt = || request().and_then(Answer::read);
    let mut answer = attempt();
    for times in 1..ATTEMPTS {
        if !answer.as_ref().map_or(true, Answer::is_passing) {
            break;
        }
        clock::sleep(FIRST_WAIT * 2u32.pow(times - 1));
        answer = attempt();
    }
    answer.map_err(|error| format!("the service cannot be reached: {error}"))
}

impl Objects for Service {
    fn get(&self, key: &str) -> Result<Option<Object>, String> {
        let key = self.key(key);
        let answer = answered(|| {
            let action = GetObject::new(&self.bucket, Some(&self.credentials), &key);
            self.agent.get(action.sign(SIGNED_FOR).as_str()).call()
        })?;
        match answer.status {
            StatusCode::OK => Ok(Some(Object {
                bytes: answer.bytes,
                tag: answer.tag,
            })),
            StatusCode::NOT_FOUND if !says(&answer, "NoSuchBucket") => Ok(None),
            _ => answer.refused(),
        }
    }

    fn put(&self, key: &str, bytes: &[u8], when: WriteCondition<'_>) -> Result<bool, String> {
        let key = self.key(key);
        let answer = answered(|| {
            let action = PutObject::new(&self.bucket, Some(&self.credentials), &key);
            let request = self.agent.put(action.sign(SIGNED_FOR).as_str());
            match when {
                WriteCondition::Always => request,
                WriteCondition::New => request.header("if-none-match", "*"),
                WriteCondition::Unchanged(tag) => request.header("if-match", tag),
            }
            .send(bytes)
        })?;
        match answer.status {
            StatusCode::OK | StatusCode::CREATED | StatusCode::NO_CONTENT => Ok(true),
            StatusCode::PRECONDITION_FAILED if when != WriteCondition::Always => Ok(false),
            // The version that was to be replaced is gone.
            StatusCode::NOT_FOUND
                if matches!(when, WriteCondition::Unchanged(_)) && !says(&answer, "NoSuchBucket") =>
            {
                Ok(false)
            }
            _ => answer.refused(),
        }
    }

    fn delete(&self, key: &str) -> Result<(), String> {
        let key = self.key(key);
        let answer = answered(|| {
            let action = DeleteObject::new(&self.bucket, Some(&self.credentials), &key);
            self.agent.delete(action.sign(SIGNED_FOR).as_str()).call()
        })?;
        match answer.status {
            StatusCode::OK | StatusCode::NO_CONTENT => Ok(()),
            StatusCode::NOT_FOUND if !says(&answer, "NoSuchBucket") => Ok(()),
            _ => answer.refused(),
        }
    }

    fn list(&self, prefix: &str) -> Result<Vec<String>, String> {
        let (prefix, mut keys, mut next) = (self.key(prefix), Vec::new(), None::<String>);
        loop {
            let answer = answered(|| {
                let mut action = ListObjectsV2::new(&self.bucket, Some(&self.credentials));
                action.with_prefix(prefix.as_str());
                if let Some(next) = &next {
                    action.with_continuation_token(next.as_str());
                }
                self.agent.get(action.sign(SIGNED_FOR).as_str()).call()
            })?;
            if answer.status != StatusCode::OK {
                return answer.refused();
            }
            let text = String::from_utf8_lossy(&answer.bytes);
            let page = ListObjectsV2::parse_response(&text)
                .map_err(|error| format!("its list cannot be read: {error}"))?;
            let own = page.contents.into_iter().map(|it| it.key);
            keys.extend(own.filter_map(|key| Some(key.strip_prefix(self.prefix.as_str())?.to_owned())));
            next = page.next_continuation_token;
            if next.is_none() {
                return Ok(keys);
            }
        }
    }
}

fn says(answer: &Answer, code: &str) -> bool {
    String::from_utf8_lossy(&answer.bytes).contains(code)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(name: &str) -> Option<String> {
        matches!(name, "AWS_ACCESS_KEY_ID" | "AWS_SECRET_ACCESS_KEY").then(|| "key".into())
    }

    #[test]
    fn an_address_names_a_bucket_and_a_prefix() {
        assert_eq!(parts("s3://lab"), Ok(("lab", String::new())));
        assert_eq!(parts("s3://lab/"), Ok(("lab", String::new())));
        assert_eq!(parts("s3://lab/a/b/"), Ok(("lab", "a/b/".into())));
        assert!(parts("s3:///a").is_err() && parts("lab/a").is_err());
    }

    #[test]
    fn a_service_is_named_by_the_usual_variables() {
        let of = |more: &[(&str, &str)]| {
            let variable = |name: &str| {
                let more = more.iter().find(|(known, _)| *known == name);
                more.map(|(_, value)| (*value).to_owned()).or_else(|| keys(name))
            };
            Service::at("s3://lab/a", variable)
        };
        let url = |service: Result<Service, String>| {
            let service = service.unwrap();
            service.bucket.object_url(&service.key("trials/ab")).to_string()
        };
        assert_eq!(url(of(&[])), "https://lab.s3.us-east-1.amazonaws.com/a/trials/ab");
        assert_eq!(
            url(of(&[("AWS_REGION", "eu-central-1")])),
            "https://lab.s3.eu-central-1.amazonaws.com/a/trials/ab"
        );
        assert_eq!(
            url(of(&[("AWS_ENDPOINT_URL", "http://127.0.0.1:9000")])),
            "http://127.0.0.1:9000/lab/a/trials/ab"
        );
        assert!(
            of(&[("AWS_ENDPOINT_URL", "9000")])
                .unwrap_err()
                .contains("AWS_ENDPOINT_URL")
        );
    }

    #[test]
    fn keys_are_asked_for_and_never_shown() {
        let error = Service::at("s3://lab", |_| None).unwrap_err();
        assert!(error.contains("AWS_ACCESS_KEY_ID"), "{error}");
        let shown = format!("{:?}", Service::at("s3://lab/a", keys).unwrap());
        assert_eq!(shown, "s3://lab/a/");
    }
}
