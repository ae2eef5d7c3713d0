import pickle

from drivers.gphoto.messages import LENGTH, packed


def test_a_message_follows_its_length() -> None:
    sent = packed(("read", ("iso",)))
    head, raw = sent[: LENGTH.size], sent[LENGTH.size :]
    assert LENGTH.unpack(head) == (len(raw),)
    assert pickle.loads(raw) == ("read", ("iso",))
