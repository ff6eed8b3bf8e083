"""Signatures, held against botocore's own signer, against everything that was not signed so, and against replays."""

from dataclasses import replace
from urllib.parse import quote, urlencode

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.errors import AccessRefused
from tasks.gateway.access.signature import UsedSignatures, check_signature, claim_of
from tasks.gateway.rest_json import HttpRequest
from tests.gateway.signed_requests import KEY_ID, SECRET, changed, header, now_s, signed_request

ARN = "arn:aws:robomaker:us-east-1:123456789012:deployment-fleet/home/1600000000000"
_TEXT = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=12)
_PARTS = st.lists(_TEXT.filter(lambda part: part not in {".", ".."}), max_size=3)
_PAIRS = st.lists(st.tuples(_TEXT, st.one_of(st.just(""), _TEXT)), max_size=4)
ONE, OTHER = "ab" * 32, "cd" * 32


def passes(request: HttpRequest, now: float | None = None) -> None:
    claim = claim_of(request, now_s() if now is None else now)
    assert claim.key_id == KEY_ID
    check_signature(request, claim, SECRET)


def refusal(request: HttpRequest, now: float | None = None) -> AccessRefused:
    with pytest.raises(AccessRefused) as caught:
        passes(request, now)
    return caught.value


@given(method=st.sampled_from(["GET", "POST", "DELETE"]), parts=_PARTS, pairs=_PAIRS, body=st.binary(max_size=60))
def test_whatever_botocore_signs_is_accepted(
    method: str, parts: list[str], pairs: list[tuple[str, str]], body: bytes
) -> None:
    target = "/" + "/".join(quote(part, safe="") for part in parts)
    query = urlencode(pairs)
    passes(signed_request(method, f"{target}?{query}" if query else target, body))


@given(st.lists(st.sampled_from(["a=", "a", "a=1", "a1=", "a=%20", "b=2", "A=1", "tagKeys=x", ""]), max_size=5))
def test_repeated_and_empty_query_keys_are_signed_as_botocore_does(pairs: list[str]) -> None:
    query = "&".join(pairs)
    passes(signed_request("DELETE", f"/tags/{quote(ARN, safe='')}" + (f"?{query}" if query else "")))


@given(st.dictionaries(st.sampled_from(["x-amz-meta", "accept", "amz-sdk-request"]), st.text("ab ;,=\té", max_size=9)))
def test_headers_are_folded_as_botocore_does(headers: dict[str, str]) -> None:
    passes(signed_request(headers=headers))


def test_an_arn_in_the_path_is_encoded_twice() -> None:
    passes(signed_request("GET", f"/tags/{quote(ARN, safe='')}"))


def test_the_hash_of_the_body_may_be_sent() -> None:
    digest = "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"  # of {}
    passes(signed_request(headers={"x-amz-content-sha256": digest}))


def test_every_region_is_taken() -> None:
    passes(signed_request(region="mars-north-1"))


@pytest.mark.parametrize(
    "change",
    [
        {"body": b'{"name": "other"}'},
        {"body": b""},
        {"method": "DELETE"},
        {"raw_path": "/deleteFleet"},
        {"raw_path": "/create%46leet"},
        {"raw_path": "/createFleet/"},
        {"query": "a=1"},
    ],
)
def test_a_request_that_was_changed_is_refused(change: dict[str, str]) -> None:
    assert refusal(replace(signed_request(), **change)).code == "InvalidSignatureException"


@pytest.mark.parametrize("path", ["//createFleet", "/x/../createFleet", "/./createFleet", "/createFleet/..", "/x/."])
def test_paths_that_a_signer_would_shorten_are_refused(path: str) -> None:
    # botocore signs the short form, so the signature itself would fit.
    assert "empty part" in str(refusal(signed_request(target=path)))


def test_a_re_encoded_path_is_refused() -> None:
    request = signed_request("GET", f"/tags/{quote(ARN, safe='')}")
    assert refusal(replace(request, raw_path=f"/tags/{quote(ARN, safe=':')}")).status == 403


def test_a_re_encoded_query_is_refused() -> None:
    request = signed_request("DELETE", "/tags/x?tagKeys=a%2Fb")
    assert refusal(replace(request, query="tagKeys=a/b")).status == 403


@pytest.mark.parametrize("field", ["host", "x-amz-date", "content-type"])
def test_a_signed_header_with_another_value_is_refused(field: str) -> None:
    request = signed_request(headers={"content-type": "application/json"})
    other = {"host": "other.example", "x-amz-date": "20200101T000000Z", "content-type": "text/plain"}[field]
    assert refusal(changed(request, **{field: other})).code == "InvalidSignatureException"


def test_a_signed_header_that_is_gone_is_refused() -> None:
    request = changed(signed_request(headers={"content-type": "application/json"}), content_type=None)
    assert "not there: content-type" in str(refusal(request))


def test_another_secret_is_refused() -> None:
    assert refusal(signed_request(secret="guess")).code == "InvalidSignatureException"  # noqa: S106


def test_a_request_without_a_signature_is_refused() -> None:
    refused = refusal(changed(signed_request(), authorization=None))
    assert refused.code == "MissingAuthenticationTokenException"
    assert "simyard access export" in str(refused)


def test_a_presigned_address_is_refused_with_its_name() -> None:
    request = replace(changed(signed_request(), authorization=None), query="X-Amz-Signature=00")
    assert "presigned" in str(refusal(request))


def test_a_session_token_is_refused() -> None:
    assert "AWS_SESSION_TOKEN" in str(refusal(signed_request(headers={"x-amz-security-token": "t"})))


@pytest.mark.parametrize("offset_s", [-301, 301])
def test_a_request_of_another_time_is_refused(offset_s: int) -> None:
    assert "set the client's clock" in str(refusal(signed_request(), now_s() + offset_s + offset_s / 100))


@pytest.mark.parametrize("offset_s", [-295, 295])
def test_clocks_may_differ_a_little(offset_s: int) -> None:
    passes(signed_request(), now_s() + offset_s)


@pytest.mark.parametrize("stamp", ["", "yesterday", "20261332T000000Z", "\uff120260101T000000Z", "20260101T000000Z "])
def test_a_date_that_is_none_is_refused(stamp: str) -> None:
    assert refusal(changed(signed_request(), x_amz_date=stamp)).status in {400, 403}


def test_a_date_that_is_missing_is_refused() -> None:
    assert "x-amz-date" in str(refusal(changed(signed_request(), x_amz_date=None)))


def test_another_service_is_refused() -> None:
    assert "robomaker" in str(refusal(signed_request(service="s3")))


def test_the_day_of_the_scope_is_that_of_the_date() -> None:
    request = signed_request()
    day = header(request, "x-amz-date")[:8]
    text = header(request, "authorization").replace(f"/{day}/", "/20200101/")
    assert "Credential is" in str(refusal(changed(request, authorization=text)))


@pytest.mark.parametrize("name", ["host", "x-amz-date", "x-amz-meta"])
def test_headers_that_must_be_signed_are(name: str) -> None:
    request = signed_request(headers={"x-amz-meta": "1"})
    text = header(request, "authorization")
    names = text.partition("SignedHeaders=")[2].partition(",")[0]
    fewer = ";".join(each for each in names.split(";") if each != name)
    assert f"not signed: {name}" in str(refusal(changed(request, authorization=text.replace(names, fewer))))


@pytest.mark.parametrize("said", ["UNSIGNED-PAYLOAD", "STREAMING-AWS4-HMAC-SHA256-PAYLOAD", "0" * 64])
def test_a_body_that_is_not_signed_is_refused(said: str) -> None:
    # botocore signs whatever the header says, so the signature itself would fit.
    assert "not the SHA-256 of the body" in str(refusal(signed_request(headers={"x-amz-content-sha256": said})))


def test_an_authorization_cut_anywhere_is_refused() -> None:
    request = signed_request()
    text = header(request, "authorization")
    for length in range(len(text)):
        assert refusal(changed(request, authorization=text[:length])).status in {400, 403}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("AWS4-HMAC-SHA256 ", "AWS4-HMAC-SHA1 "),
        ("Signature=", "Signature=0, Signature="),
        ("Credential=", "Other=1, Credential="),
        ("SignedHeaders=", "SignedHeaders=x-amz-date;"),
        ("host;", "Host;"),
        ("/robomaker/", "/robomaker/robomaker/"),
        (", ", " "),
    ],
)
def test_an_authorization_of_another_form_is_refused(old: str, new: str) -> None:
    request = signed_request()
    text = header(request, "authorization")
    assert old in text
    assert refusal(changed(request, authorization=text.replace(old, new, 1))).status in {400, 403}


def test_a_signature_in_capital_letters_is_refused() -> None:
    request = signed_request()
    text, _, signature = header(request, "authorization").rpartition("=")
    assert refusal(changed(request, authorization=f"{text}={signature.upper()}")).status == 400


@pytest.mark.parametrize("name", ["host", "authorization", "x-amz-date"])
def test_what_decides_comes_once(name: str) -> None:
    request = signed_request()
    twice = replace(request, headers=(*request.headers, (name, header(request, name))))
    assert "more than once" in str(refusal(twice))


def test_a_signature_is_used_once() -> None:
    used = UsedSignatures()
    used.use(ONE, 0)
    used.use(OTHER, 1)
    with pytest.raises(AccessRefused, match="sent before"):
        used.use(ONE, 2)


def test_an_equal_request_of_the_same_second_may_be_a_retry_and_is_told_to_come_later() -> None:
    used = UsedSignatures()
    used.use(ONE, 0)
    codes: list[str] = []
    for at_s in (0.5, 1.9, 2.1, 600):
        with pytest.raises(AccessRefused, match="sent before") as caught:
            used.use(ONE, at_s)
        codes.append(caught.value.code)
    assert codes == ["ThrottlingException"] * 2 + ["InvalidSignatureException"] * 2


def test_it_is_remembered_for_as_long_as_it_is_good() -> None:
    used = UsedSignatures()
    used.use(ONE, 0)
    with pytest.raises(AccessRefused, match="sent before"):
        used.use(ONE, 600)
    used.use(ONE, 601)


def test_what_could_not_be_remembered_is_refused() -> None:
    used = UsedSignatures(most=1)
    used.use(ONE, 0)
    with pytest.raises(AccessRefused, match="wait") as caught:
        used.use(OTHER, 1)
    assert caught.value.code == "ThrottlingException"
    used.use(OTHER, 601)
