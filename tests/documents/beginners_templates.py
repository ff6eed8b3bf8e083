"""Templates as beginners write them, each with a fault; template_faults.txt beside this says what they are told."""

from collections.abc import Mapping

from pydantic import JsonValue

Body = dict[str, JsonValue]
KITCHEN: Body = {"Type": "Kitchen", "Name": "Kitchen"}


def home(plan: JsonValue = None, inside: JsonValue = None, version: str = "1", **floor: JsonValue) -> Body:
    """Returns a body with a floor plan, an interior, and more beside them."""
    parts: Body = {"Floorplan": plan, "Interior": inside}
    given = {key: value for key, value in parts.items() if value is not None}
    return {"Version": version, "Buildings": [{"Floors": [{**given, **floor}]}]}


def kitchen(**more: JsonValue) -> Body:
    """Returns a body with a kitchen that has more keys."""
    return home({"Rooms": [{**KITCHEN, **more}]})


def shaped(shape: JsonValue) -> Body:
    """Returns a body with a kitchen of some shape."""
    return kitchen(DesiredShape=shape)


def furnished(furniture: JsonValue) -> Body:
    """Returns a body with a kitchen and furniture."""
    return home({"Rooms": [KITCHEN]}, {"Furniture": furniture})


def arranged(**more: JsonValue) -> Body:
    """Returns a body with a kitchen and an arrangement for it that has more keys."""
    arrangement: Body = {"Name": "a", "TargetSet": {"RoomNames": ["Kitchen"]}, **more}
    return furnished({"FurnitureArrangements": [arrangement]})


def doorways(**more: JsonValue) -> Body:
    """Returns a body of version 2 with a set of doors that has more keys."""
    return home({"Rooms": [KITCHEN]}, {"Doorways": {"DoorwaySets": [{"Name": "d", **more}]}}, version="2")


def doors(door: JsonValue) -> Body:
    """Returns a body of version 2 with these doors."""
    return doorways(TargetSet="Target.All", Door=door)


def connected(*location: str, kind: str = "Doorway") -> Body:
    """Returns a body with a kitchen and a connection."""
    return home({"Rooms": [KITCHEN], "DesiredConnections": [{"Location": [*location], "ConnectionType": kind}]})


LEVELS: Mapping[str, Body] = {
    "rooms at the top": {"Version": "1", "Rooms": [KITCHEN]},
    "a floor plan at the top": {"Floorplan": {"Rooms": [KITCHEN]}},
    "rooms in the building": {"Buildings": [{"Rooms": [KITCHEN]}]},
    "the interior inside the floor plan": home({"Rooms": [KITCHEN], "Interior": {}}),
    "furniture beside the interior": home({"Rooms": [KITCHEN]}, {}, Furniture={}),
    "furniture in the room": kitchen(Furniture=["Fridges"]),
    "flooring in the room": kitchen(Flooring="Tiles"),
    "an area in the room": kitchen(Area=12),
    "proportions in the room": kitchen(AspectRatio={"x": 1, "y": 2}),
    "a height in the floor plan": home({"Rooms": [KITCHEN], "Height": 2.5}),
    "proportions of the footprint by another name": home({"Footprint": {"AspectRatio": {"x": 1, "y": 2}}}),
    "proportions without the footprint": home({"DesiredAspectRatio": {"x": 1, "y": 2}}),
    "a percentage in the door": doors({"Percent": 40}),
    "From and To in the set": doorways(From={"RoomNames": ["A"]}, To={"RoomNames": ["B"]}),
    "a wrong word on the wrong level": {"Version": "1", "Rooms": [{"Type": "Bedrom", "Name": "Bed"}]},
}
SHAPES: Mapping[str, Body] = {
    "no list of buildings": {"Buildings": {"Floors": [{}]}},
    "no list of floors": {"Buildings": [{"Floors": {"Floorplan": {}}}]},
    "rooms by name": home({"Rooms": {"Kitchen": {"Type": "Kitchen"}}}),
    "one room without a list": home({"Rooms": KITCHEN}),
    "rooms as words": home({"Rooms": ["Kitchen"]}),
    "a list of floor plans": home([{"Rooms": [KITCHEN]}]),
    "furniture as words": furnished(["Fridges"]),
    "arrangements without their key": furnished([{"Name": "a", "TargetSet": {"RoomNames": ["Kitchen"]}}]),
    "a sample set as words": arranged(SampleSet=["Fridges"]),
    "one kind of furniture without a list": arranged(SampleSet={"ModelTypes": "Fridges"}),
    "a target as a word": arranged(TargetSet="Kitchen"),
    "a target as words": arranged(TargetSet=["Kitchen"]),
    "one room's name without a list": arranged(TargetSet={"RoomNames": "Kitchen"}),
    "From and To as words": doorways(TargetSet={"From": ["Kitchen"], "To": ["Hall"]}),
    "proportions as text": shaped({"Area": 12, "AspectRatio": "1:2"}),
    "proportions as a list": shaped({"Area": 12, "AspectRatio": [1, 2]}),
    "an area as the whole shape": shaped(12),
    "a shape without proportions": shaped({"Area": 12}),
    "a ceiling as a number": home({"Ceiling": 2.5}),
    "an open position as a number": doors({"InitialState": {"OpenPosition": 40}}),
}
WORDS: Mapping[str, Body] = {
    "small letters everywhere": {
        "buildings": [{"floors": [{"floorplan": {"rooms": [{"type": "Hall", "name": "A"}]}}]}]
    },
    "a typo in a key": home({"Romms": [KITCHEN]}),
    "connections by a short name": home({"Rooms": [KITCHEN], "Connections": []}),
    "a density by a short name": arranged(Density="Dense"),
    "a key in the singular": arranged(TargetSet={"RoomName": ["Kitchen"]}),
    "a type in small letters": kitchen(Type="kitchen"),
    "a type that there is not": kitchen(Type="Office"),
    "furniture in the singular": arranged(SampleSet={"ModelTypes": ["Fridge"]}),
    "furniture by another word": arranged(SampleSet={"ModelTypes": ["Couch"]}),
    "a density in small letters": arranged(DesiredSpatialDensity="dense"),
    "random in small letters": doors({"InitialState": {"OpenPosition": {"Percent": "random"}}}),
    "another kind of connection": connected("Kitchen", "Hall", kind="Door"),
    "a connection of three": connected("Kitchen", "Hall", "Bath"),
    "a name with an umlaut": kitchen(Name="Küche"),
    "no such version": {"Version": "3"},
    "doors in version 1": home({"Rooms": [KITCHEN]}, {"Doorways": {"DoorwaySets": []}}),
}
NUMBERS: Mapping[str, Body] = {
    "a number in quotes": shaped({"Area": "12", "AspectRatio": {}}),
    "a number with a unit": shaped({"Area": "12 m2", "AspectRatio": {}}),
    "text that only begins with a number": shaped({"Area": "1:2", "AspectRatio": {}}),
    "proportions below 1": shaped({"Area": 12, "AspectRatio": {"x": 0.5, "y": 1}}),
    "a small room": shaped({"Area": 6, "AspectRatio": {}}),
    "a ceiling in centimetres": home({"Ceiling": {"Height": 250}}),
    "a version as a number": {"Version": 2},
    "a percentage with its sign": doors({"InitialState": {"OpenPosition": {"Percent": "40%"}}}),
    "no room at all": home({"Rooms": []}),
    "seven rooms": home({"Rooms": [{"Type": "Bedroom", "Name": f"Bed {number}"} for number in range(7)]}),
    "nothing behind a key": {"Buildings": [{"Floors": [{"Floorplan": {"Rooms": None}}]}]},
}
OWN_WORDS: Body = {
    "version": 2,
    "buildings": {
        "floors": [
            {
                "floorplan": {
                    "rooms": [
                        {"name": "Living", "type": "LivingRoom", "area": "25 m2"},
                        {"name": "Bath", "type": "Bathroom", "area": 8},
                    ],
                    "connections": [{"from": "Living", "to": "Bath", "type": "door"}],
                },
                "interior": {"furniture": {"Bath": ["shower"]}},
            }
        ]
    },
}
BEGINNERS: Mapping[str, Body] = {
    **LEVELS,
    **SHAPES,
    **WORDS,
    **NUMBERS,
    "a whole flat in one's own words": OWN_WORDS,
}
