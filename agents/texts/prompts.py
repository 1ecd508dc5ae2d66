"""What a language model is told. The criteria are those of AnySkill (appendix A.1), the words are ours."""

SCORE_INSTRUCTION = """\
You grade captions that shall become instructions for a simulated humanoid. The humanoid learns one skill from one short
sentence, and a picture of it must show whether it succeeded. Give a whole number from 0 (useless) to 10 (ideal).

{criterion}

Answer with JSON only, for example {{"score": 7}}."""

PLAINNESS = """\
Grade how PLAIN the caption is. It loses points for each of these:
- it is not fluent English, or has words that could be left out;
- it is long: eight words or more;
- it describes a sequence ("then", "after", "while", several steps) and not one posture or one movement;
- it has more than one verb, or more than one noun beside parts of the body.

Examples:
"raise both arms" -> 10
"squat down" -> 10
"kick with the left leg" -> 9
"the man waves his right hand" -> 8
"a person is lifting the left knee up" -> 7
"someone walks forward and then turns around" -> 3
"a man walks in a circle, sits down, gets up again and waves at somebody" -> 0
"arms the up quick put" -> 1"""

CLEARNESS = """\
Grade how CLEAR the caption is: would ten people who read it draw the same figure? It loses points for each of these:
- the name of an activity that has many forms (a dance, a sport, a game) and not what the body does;
- no word about which part of the body moves, or in which direction, where that matters;
- words that refer to something unsaid ("it", "again", "the other one");
- moods, intentions, and things that are not in the picture.

Examples:
"raise both arms above the head" -> 10
"bend forward at a right angle" -> 9
"walk forward" -> 9
"kneel on the right knee" -> 9
"raise an arm" -> 6
"wave" -> 6
"do yoga" -> 2
"dance happily" -> 1
"do it again" -> 0"""

REWRITE_INSTRUCTION = """\
You turn captions of human motion into instructions for a simulated humanoid. Describe the ONE posture or movement that shows
best what the caption means, as it would be seen in a single picture. Rules:
- fewer than eight words, lower case, no full stop;
- begin with a verb in the imperative; name nobody (not "a person", not "he");
- at most one verb, and at most one noun beside parts of the body;
- no adjectives and no adverbs; "left", "right", "both" and directions such as "up" or "forward" are welcome;
- nothing about face, eyes, or fingers;
- replace the name of an activity by what the body does.

Examples:
"a man bows politely" -> bend forward at a right angle
"the person waves hi with a big smile" -> raise the right hand beside the head
"someone does a jumping jack" -> jump with arms and legs apart
"she slowly walks to the door, then opens it" -> walk forward
"a figure warms up its shoulders" -> stretch both arms out sideways

Answer with the instruction only."""

REWRITE_AGAIN = """\
Caption: {text}
You answered: {answer}
That breaks these rules: {faults}. Answer with a corrected instruction only."""
