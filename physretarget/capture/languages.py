"""Names of body parts in other languages than English, put into English.

Japanese as MikuMikuDance's rigs have them, Chinese, German, French, Spanish. Writing without
blanks is cut at the known words, the longest first.
"""

from __future__ import annotations

import re
import unicodedata

__all__ = ["in_english"]

# Cut out of words without blanks; longer words come before those that they contain.
_JOINED = {
    # Japanese
    "センター": "hips", "グルーブ": "helper", "全ての親": "helper", "下半身": "pelvis",
    "上半身2": "chest", "上半身3": "chest", "上半身": "spine", "足首": "ankle", "手首": "wrist",
    "つま先": "toe", "ひざ": "knee", "ヒザ": "knee", "膝": "knee", "ひじ": "elbow",
    "ヒジ": "elbow", "肘": "elbow", "太もも": "thigh", "腰": "waist", "首": "neck", "頭": "head",
    "肩": "shoulder", "腕": "arm", "捩": "twist", "親指": "thumb", "人指": "index",
    "人差指": "index", "中指": "middle", "薬指": "ring", "小指": "little", "目": "eye", "足": "leg",
    # Chinese
    "大腿": "thigh", "小腿": "calf", "脚踝": "ankle", "脚掌": "foot", "脚趾": "toe", "脚尖": "toe",
    "脚": "foot", "上臂": "upperarm", "大臂": "upperarm", "前臂": "forearm", "下臂": "forearm",
    "小臂": "forearm", "锁骨": "clavicle", "鎖骨": "clavicle", "手腕": "wrist", "手掌": "hand",
    "骨盆": "pelvis", "髋": "hips", "臀部": "hips", "臀": "hips", "脊柱": "spine", "脊椎": "spine",
    "腹部": "spine", "胸部": "chest", "胸": "chest", "脖子": "neck", "颈部": "neck", "颈": "neck",
    "頸": "neck", "头部": "head", "头": "head", "根": "root", "手": "hand",
    "左": "left", "右": "right",
}  # fmt: skip
_CUT = re.compile("|".join(sorted(map(re.escape, _JOINED), key=len, reverse=True)))
_WORDS = {
    # German
    "becken": "pelvis", "hüfte": "hips", "huefte": "hips", "wirbelsäule": "spine",
    "wirbelsaeule": "spine", "rücken": "spine", "ruecken": "spine", "brust": "chest",
    "hals": "neck", "nacken": "neck", "kopf": "head", "schlüsselbein": "clavicle",
    "schluesselbein": "clavicle", "schulter": "shoulder", "oberarm": "upperarm",
    "unterarm": "forearm", "ellbogen": "elbow", "handgelenk": "wrist",
    "oberschenkel": "thigh", "unterschenkel": "shin", "schienbein": "shin", "knie": "knee",
    "fuß": "foot", "fuss": "foot", "knöchel": "ankle", "knoechel": "ankle", "zehe": "toe",
    "zehen": "toe", "linke": "left", "linker": "left", "linkes": "left", "rechte": "right",
    "rechter": "right", "rechtes": "right",
    # French
    "bassin": "pelvis", "hanches": "hips", "hanche": "hips", "colonne": "spine",
    "poitrine": "chest", "thorax": "chest", "cou": "neck", "tête": "head",
    "tete": "head", "clavicule": "clavicle",
    "épaule": "shoulder", "epaule": "shoulder", "bras": "upperarm", "avantbras": "forearm",
    "coude": "elbow", "poignet": "wrist", "main": "hand", "cuisse": "thigh", "jambe": "shin",
    "tibia": "shin", "genou": "knee", "pied": "foot", "cheville": "ankle", "orteil": "toe",
    "orteils": "toe", "droit": "right",
    # Spanish
    "cadera": "hips", "caderas": "hips", "columna": "spine", "pecho": "chest", "cuello": "neck",
    "cabeza": "head", "clavícula": "clavicle", "clavicula": "clavicle", "hombro": "shoulder",
    "brazo": "upperarm", "antebrazo": "forearm", "codo": "elbow", "muñeca": "wrist",
    "mano": "hand", "muslo": "thigh", "pierna": "shin", "espinilla": "shin", "rodilla": "knee",
    "pie": "foot", "tobillo": "ankle", "dedos": "toe", "izquierda": "left", "izquierdo": "left",
    "izq": "left", "derecha": "right", "derecho": "right", "der": "right",
}  # fmt: skip
_WORD = re.compile(r"[a-zà-ÿß]+", re.IGNORECASE)


def in_english(name: str) -> str:
    """A joint's name with the words of the body that are not English put into English.

    Wide letters and digits (as in "左足ＩＫ") become plain ones; what is not known stays.
    """
    plain = unicodedata.normalize("NFKC", name)
    if plain.isascii() and not any(word.lower() in _WORDS for word in _words(plain)):
        return plain
    cut = _CUT.sub(lambda match: f" {_JOINED[match[0]]} ", plain)
    cut = re.sub(r"([a-zß-ÿ])([A-ZÀ-Þ])", r"\1 \2", cut)
    return _WORD.sub(lambda match: _WORDS.get(match[0].lower(), match[0]), cut).strip()


def _words(name: str) -> list[str]:
    return _WORD.findall(re.sub(r"([a-z])([A-Z])", r"\1 \2", name))
