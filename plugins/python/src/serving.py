

# --- Answers to requests -------------------------------------------------------------------------------------


def serve(link, held):
    """Answers until the last request: one byte for requests in shared memory, or a byte and a text."""
    commands = held.commands()
    while byte := link.byte():
        text = None if byte == b"s" else link.text()
        try:
            answer = (b"k", None) if text is None else commands[byte](text)
            if text is None:
                held.answer_requests()
        except Exception as error:
            answer = b"e", told(error).encode()
        link.say(*answer)
    held.end()


def main():
    # This process ignores signals to the whole process group.
    for name in ("SIGINT", "SIGTERM", "SIGUSR1"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    guard()
    # The folder in which the program runs is not part of the sources.
    sys.path[:] = [path for path in sys.path if path]
    link = Link()
    # Awake: from here on the guard ends all processes that this one starts.
    link.say(b"w")
    asked = json.loads(link.text())
    try:
        held = OwnAgent(asked) if "agent" in asked else Server(asked)
        face = json.dumps(held.face()).encode()
    except Exception as error:
        link.say(b"e", refusal(error, asked["lock"], asked["interpreter"]))
        os._exit(1)
    link.say(b"k", face)
    try:
        serve(link, held)
    except SystemExit as left:
        # The exit of an environment becomes the exit code of this process.
        os._exit(left.code if isinstance(left.code, int) else 1)
    os._exit(0)


main()
