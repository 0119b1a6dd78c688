"""German lines that stages report, and why a button is grey. Errors of the engine stay English."""

from __future__ import annotations

MESSAGES: dict[str, str] = {
    # what was done
    "{} quads, nothing to complain about": "{} Vierecke, nichts zu beanstanden",
    "{} quads, {} warnings": "{} Vierecke, {} Warnungen",
    "'{}': {} quads, edge {:.3g} mm": "'{}': {} Vierecke, Kante {:.3g} mm",
    "Scaled by {:.4g}": "Skaliert mit {:.4g}",
    "Vertices moved by up to {:.0%} of an edge": "Punkte um bis zu {:.0%} einer Kante verschoben",
    "{} patches, largest distortion {:.3f}": "{} Flicken, größte Verzerrung {:.3f}",
    "{} spirals, twist {:.0f} to {:.0f}\N{DEGREE SIGN}": "{} Spiralen, Windung {:.0f} bis {:.0f}\N{DEGREE SIGN}",
    "Distance to the target: RMS {:.2f} mm, {:.2f} %.": "Abstand zum Ziel: RMS {:.2f} mm, {:.2f} %.",
    "Strain reaches {:.0f} % of what the material bears: arms break or stay bent.": "Die Dehnung erreicht {:.0f} % dessen, was das Material erträgt: Arme brechen oder bleiben gebogen.",
    "Stopped; the best so far is kept": "Angehalten; das Beste bis dahin bleibt",
    "RMSE {:.3g} to {:.3g} mm in {} steps": "RMSE {:.3g} auf {:.3g} mm in {} Schritten",
    "{} in {}": "{} in {}",
    "{} spirals, {} triangles in {:.1f} s": "{} Spiralen, {} Dreiecke in {:.1f} s",
    "{} panels in {} frames; play them with the space bar": "{} Teile in {} Bildern; mit der Leertaste abspielen",
    "{} half-finished pieces (panel-seam {}) find no rest; blends stand in": "{} halbfertige Stücke (Teil-Naht {}) finden keine Ruhelage; an ihrer Stelle wird überblendet",
    "Not simulated yet: the hubs lie on the target": "Noch nicht simuliert: die Naben liegen auf dem Ziel",
    "The mesh or a setting was changed since; press Simulate again": "Das Netz oder eine Einstellung wurde seitdem verändert; nochmals Simulieren drücken",
    "{} frames in {}": "{} Bilder in {}",
    "{}, {} x {} pixels, in {}": "{}, {} x {} Pixel, in {}",
    "{} pictures for the image editor; {}": "{} Bilder für den Bildeditor; {}",
    "{} pictures for the image editor; save the .blend file to get the page too": "{} Bilder für den Bildeditor; .blend-Datei speichern, um auch die Seite zu erhalten",
    # what goes on
    "{} was stopped; nothing was changed": "{} wurde angehalten; nichts wurde verändert",
    "{} is running; wait for it, or stop it with ESC": "{} läuft; warten, oder mit ESC anhalten",
    "{}: stopping": "{}: hält an",
    "ESC: stop": "ESC: anhalten",
    # why not
    "There is nothing to show yet; press {} first": "Es gibt noch nichts zu zeigen; erst {} drücken",
    "There is nothing to show; press Check first": "Es gibt nichts zu zeigen; erst Prüfen drücken",
    "There is no preset {}; choose another one": "Es gibt keine Vorgabe {}; eine andere wählen",
    "Select a mesh object": "Ein Netzobjekt auswählen",
    "'{}' is not a mesh; select one, or convert it to a mesh": "'{}' ist kein Netz; eines auswählen, oder es in ein Netz umwandeln",
    "'{}' is linked from another file; make it local first": "'{}' ist aus einer anderen Datei verknüpft; erst lokal machen",
    "Apply or remove the modifier '{}' first: the layout lives in the mesh itself": "Erst den Modifikator '{}' anwenden oder entfernen: die Flicken liegen im Netz selbst",
    "Go to Object Mode or Edit Mode": "In den Objekt- oder Bearbeitungsmodus wechseln",
    "Go to Object Mode: a new object is made": "In den Objektmodus wechseln: ein neues Objekt entsteht",
    "Remove the shape keys first: they fix the vertices": "Erst die Formschlüssel entfernen: sie halten die Punkte fest",
    "The object's scale is locked; unlock it first": "Die Skalierung des Objekts ist gesperrt; erst entsperren",
    "Merge or flatten first": "Erst zusammenführen oder abwickeln",
    "Trace, merge or flatten first": "Erst Schnitte ziehen, zusammenführen oder abwickeln",
    "Press Spirals first": "Erst Spiralen drücken",
    "Press Simulate or Optimise first": "Erst Simulieren oder Optimieren drücken",
}
