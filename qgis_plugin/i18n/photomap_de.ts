<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="de">
<context>
    <name>photomap</name>
    <message>
        <source>What has changed?</source>
        <translation>Was hat sich geändert?</translation>
    </message>
    <message>
        <source>automatic</source>
        <translation>automatisch</translation>
    </message>
    <message>
        <source>&amp;Compare</source>
        <translation>&amp;Vergleichen</translation>
    </message>
    <message>
        <source>&amp;Old imagery</source>
        <translation>&amp;Alte Bilddaten</translation>
    </message>
    <message>
        <source>&amp;New map</source>
        <translation>&amp;Neue Karte</translation>
    </message>
    <message>
        <source>Changed from a &amp;score of</source>
        <translation>Geändert ab einem &amp;Wert von</translation>
    </message>
    <message>
        <source>S&amp;mallest area</source>
        <translation>&amp;Kleinste Fläche</translation>
    </message>
    <message>
        <source>Comparing…</source>
        <translation>Wird verglichen …</translation>
    </message>
    <message>
        <source>Choose two raster layers: the old imagery, and the new map.</source>
        <translation>Wählen Sie zwei Rasterlayer: die alten Bilddaten und die neue Karte.</translation>
    </message>
    <message>
        <source>Probability of change</source>
        <translation>Wahrscheinlichkeit einer Änderung</translation>
    </message>
    <message>
        <source>Changes: {}</source>
        <translation>Änderungen: {}</translation>
    </message>
    <message>
        <source>{} changed area(s), {} m² in all.</source>
        <translation>{} geänderte Fläche(n), zusammen {} m².</translation>
    </message>
    <message>
        <source>“{}” is no file on this machine: export it as a GeoTIFF first.</source>
        <translation>„{}“ ist keine Datei auf diesem Rechner: zuerst als GeoTIFF exportieren.</translation>
    </message>
    <message>
        <source>{} cannot be made ({}): choose another folder in the settings.</source>
        <translation>{} kann nicht angelegt werden ({}): wählen Sie in den Einstellungen einen anderen Ordner.</translation>
    </message>
    <message>
        <source>Export a photo map</source>
        <translation>Fotokarte exportieren</translation>
    </message>
    <message>
        <source>Formats</source>
        <translation>Formate</translation>
    </message>
    <message>
        <source>the mission's, or that of the format</source>
        <translation>das der Mission oder des Formats</translation>
    </message>
    <message>
        <source>the map's own</source>
        <translation>das der Karte</translation>
    </message>
    <message>
        <source>Only what the &amp;window shows</source>
        <translation>Nur was das &amp;Fenster zeigt</translation>
    </message>
    <message>
        <source>all of it</source>
        <translation>alles</translation>
    </message>
    <message>
        <source>none</source>
        <translation>keine</translation>
    </message>
    <message>
        <source>&amp;Add the GeoTIFF to the project</source>
        <translation>GeoTIFF zum Projekt &amp;hinzufügen</translation>
    </message>
    <message>
        <source>&amp;Export</source>
        <translation>&amp;Exportieren</translation>
    </message>
    <message>
        <source>Choose a mission.</source>
        <translation>Wählen Sie eine Mission.</translation>
    </message>
    <message>
        <source>Tick at least one format.</source>
        <translation>Haken Sie mindestens ein Format an.</translation>
    </message>
    <message>
        <source>Choose the folder to write to.</source>
        <translation>Wählen Sie den Ordner, in den geschrieben wird.</translation>
    </message>
    <message>
        <source>The layer that cuts has no coordinate system: set it in the layer's properties.</source>
        <translation>Der Layer zum Zuschneiden hat kein Koordinatensystem: in den Layereigenschaften setzen.</translation>
    </message>
    <message>
        <source>Exporting…</source>
        <translation>Wird exportiert …</translation>
    </message>
    <message>
        <source>&amp;Mission</source>
        <translation>&amp;Mission</translation>
    </message>
    <message>
        <source>&amp;Formats</source>
        <translation>&amp;Formate</translation>
    </message>
    <message>
        <source>F&amp;older</source>
        <translation>&amp;Ordner</translation>
    </message>
    <message>
        <source>C&amp;RS</source>
        <translation>&amp;KBS</translation>
    </message>
    <message>
        <source>&amp;Pixel</source>
        <translation>&amp;Pixel</translation>
    </message>
    <message>
        <source>&amp;Compression of the GeoTIFF</source>
        <translation>&amp;Kompression des GeoTIFF</translation>
    </message>
    <message>
        <source>&amp;Tiles as</source>
        <translation>K&amp;acheln als</translation>
    </message>
    <message>
        <source>Only insi&amp;de</source>
        <translation>Nur &amp;innerhalb von</translation>
    </message>
    <message>
        <source>&amp;Burn into a copy of</source>
        <translation>&amp;Einbrennen in eine Kopie von</translation>
    </message>
    <message>
        <source>Cred&amp;it</source>
        <translation>&amp;Urheber</translation>
    </message>
    <message>
        <source>The imagery to burn into is no file on this machine: export it as a GeoTIFF first.</source>
        <translation>Die Bilddaten zum Einbrennen sind keine Datei auf diesem Rechner: zuerst als GeoTIFF exportieren.</translation>
    </message>
    <message>
        <source>Burning into existing imagery writes a GeoTIFF: tick that format alone.</source>
        <translation>Einbrennen in vorhandene Bilddaten schreibt ein GeoTIFF: nur dieses Format anhaken.</translation>
    </message>
    <message>
        <source>Written: {}</source>
        <translation>Geschrieben: {}</translation>
    </message>
    <message>
        <source>This map has no place on Earth yet, which {} needs: pick two points first.</source>
        <translation>Diese Karte hat noch keinen Ort auf der Erde, den {} braucht: zuerst zwei Punkte wählen.</translation>
    </message>
    <message>
        <source>Open the folder</source>
        <translation>Ordner öffnen</translation>
    </message>
    <message>
        <source>{}: export {}</source>
        <translation>{}: Export {}</translation>
    </message>
    <message>
        <source>The folder cannot be made ({}): choose another one.</source>
        <translation>Der Ordner kann nicht angelegt werden ({}): wählen Sie einen anderen.</translation>
    </message>
    <message>
        <source>The area that is cut to cannot be handed over: {}</source>
        <translation>Die Fläche zum Zuschneiden kann nicht übergeben werden: {}</translation>
    </message>
    <message>
        <source>GeoTIFF, cloud-optimised: QGIS, ArcGIS, ATAK</source>
        <translation>GeoTIFF, cloud-optimiert: QGIS, ArcGIS, ATAK</translation>
    </message>
    <message>
        <source>KMZ: Google Earth, ATAK</source>
        <translation>KMZ: Google Earth, ATAK</translation>
    </message>
    <message>
        <source>MBTiles: QGIS, ATAK, phones</source>
        <translation>MBTiles: QGIS, ATAK, Telefone</translation>
    </message>
    <message>
        <source>GeoPackage with overviews: QGIS, ArcGIS, ATAK</source>
        <translation>GeoPackage mit Übersichten: QGIS, ArcGIS, ATAK</translation>
    </message>
    <message>
        <source>ATAK data package: map, outline and finds</source>
        <translation>ATAK-Datenpaket: Karte, Umriss und Funde</translation>
    </message>
    <message>
        <source>GeoPDF: paper, Avenza Maps</source>
        <translation>GeoPDF: Papier, Avenza Maps</translation>
    </message>
    <message>
        <source>Vectors: track, cameras, footprints, outline, finds</source>
        <translation>Vektoren: Flugweg, Kameras, Bildflächen, Umriss, Funde</translation>
    </message>
    <message>
        <source>Layers: accuracy, age, searched, views</source>
        <translation>Layer: Genauigkeit, Alter, Abgesucht, Ansichten</translation>
    </message>
    <message>
        <source>Poses: a row a frame (CSV)</source>
        <translation>Posen: eine Zeile je Bild (CSV)</translation>
    </message>
    <message>
        <source>XYZ tiles with a page that works offline</source>
        <translation>XYZ-Kacheln mit einer Seite, die ohne Netz geht</translation>
    </message>
    <message>
        <source>TMS tiles</source>
        <translation>TMS-Kacheln</translation>
    </message>
    <message>
        <source>PMTiles: any web server</source>
        <translation>PMTiles: jeder Webserver</translation>
    </message>
    <message>
        <source>PNG with world file</source>
        <translation>PNG mit World-Datei</translation>
    </message>
    <message>
        <source>STAC item: catalogues</source>
        <translation>STAC-Eintrag: Kataloge</translation>
    </message>
    <message>
        <source>&amp;Pick pairs</source>
        <translation>Paare &amp;wählen</translation>
    </message>
    <message>
        <source>&amp;Remove</source>
        <translation>&amp;Entfernen</translation>
    </message>
    <message>
        <source>&amp;Solve with these pairs</source>
        <translation>Mit diesen Paaren &amp;lösen</translation>
    </message>
    <message>
        <source>&amp;Forget picks and nudges</source>
        <translation>Paare und Verschiebungen &amp;vergessen</translation>
    </message>
    <message>
        <source>choose a raster layer</source>
        <translation>Rasterlayer wählen</translation>
    </message>
    <message>
        <source>one of its pixels</source>
        <translation>eines ihrer Pixel</translation>
    </message>
    <message>
        <source>&amp;Lay the map on it</source>
        <translation>Karte darauf &amp;legen</translation>
    </message>
    <message>
        <source>names with commas, or every-third</source>
        <translation>Namen mit Kommas, oder every-third</translation>
    </message>
    <message>
        <source>Solve with &amp;these points</source>
        <translation>Mit diesen &amp;Punkten lösen</translation>
    </message>
    <message>
        <source>&amp;Drag the map…</source>
        <translation>Karte &amp;ziehen …</translation>
    </message>
    <message>
        <source>&amp;Move the map</source>
        <translation>Karte ver&amp;schieben</translation>
    </message>
    <message>
        <source>Starting the engine…</source>
        <translation>Engine wird gestartet …</translation>
    </message>
    <message>
        <source>M&amp;ission</source>
        <translation>&amp;Mission</translation>
    </message>
    <message>
        <source>Pie&amp;ce</source>
        <translation>&amp;Teil</translation>
    </message>
    <message>
        <source>Click a place in the map above, and the same place in the QGIS window.</source>
        <translation>Klicken Sie einen Ort in der Karte oben und denselben Ort im QGIS-Fenster.</translation>
    </message>
    <message>
        <source>Pairs</source>
        <translation>Paare</translation>
    </message>
    <message>
        <source>Imagery</source>
        <translation>Bilddaten</translation>
    </message>
    <message>
        <source>Points</source>
        <translation>Punkte</translation>
    </message>
    <message>
        <source>By hand</source>
        <translation>Von Hand</translation>
    </message>
    <message>
        <source>Add the mission to the project first: there is no map to drag.</source>
        <translation>Fügen Sie die Mission zuerst dem Projekt hinzu: es gibt keine Karte zum Ziehen.</translation>
    </message>
    <message>
        <source>&amp;Imagery</source>
        <translation>&amp;Bilddaten</translation>
    </message>
    <message>
        <source>Its own error (si&amp;gma)</source>
        <translation>Ihr eigener Fehler (Si&amp;gma)</translation>
    </message>
    <message>
        <source>Fil&amp;e</source>
        <translation>&amp;Datei</translation>
    </message>
    <message>
        <source>For the chec&amp;k</source>
        <translation>Zur &amp;Prüfung</translation>
    </message>
    <message>
        <source>&amp;East</source>
        <translation>&amp;Ost</translation>
    </message>
    <message>
        <source>&amp;North</source>
        <translation>&amp;Nord</translation>
    </message>
    <message>
        <source>Cloc&amp;kwise</source>
        <translation>Im &amp;Uhrzeigersinn</translation>
    </message>
    <message>
        <source>All</source>
        <translation>Alle</translation>
    </message>
    <message>
        <source>The map lies anew: {}</source>
        <translation>Die Karte liegt neu: {}</translation>
    </message>
    <message>
        <source>CE90 {} m, tested by {} check point(s).</source>
        <translation>CE90 {} m, geprüft an {} Prüfpunkt(en).</translation>
    </message>
    <message>
        <source>Residual of the fit: {} m (not the accuracy).</source>
        <translation>Restfehler der Ausgleichung: {} m (nicht die Genauigkeit).</translation>
    </message>
    <message>
        <source>Control points</source>
        <translation>Passpunkte</translation>
    </message>
    <message>
        <source>CE90 {} m, predicted; only check points can test it.</source>
        <translation>CE90 {} m, vorhergesagt; nur Prüfpunkte können das prüfen.</translation>
    </message>
    <message>
        <source>The mission's map</source>
        <translation>Die Karte der Mission</translation>
    </message>
    <message>
        <source>Pairs of places</source>
        <translation>Paare von Orten</translation>
    </message>
    <message>
        <source>Role</source>
        <translation>Rolle</translation>
    </message>
    <message>
        <source>Miss (m)</source>
        <translation>Abstand (m)</translation>
    </message>
    <message>
        <source>East</source>
        <translation>Ost</translation>
    </message>
    <message>
        <source>North</source>
        <translation>Nord</translation>
    </message>
    <message>
        <source>Sigma</source>
        <translation>Sigma</translation>
    </message>
    <message>
        <source>On the map</source>
        <translation>Auf der Karte</translation>
    </message>
    <message>
        <source>On Earth</source>
        <translation>Auf der Erde</translation>
    </message>
    <message>
        <source>check</source>
        <translation>Prüfung</translation>
    </message>
    <message>
        <source>control</source>
        <translation>Passpunkt</translation>
    </message>
    <message>
        <source>put aside</source>
        <translation>verworfen</translation>
    </message>
    <message>
        <source>click…</source>
        <translation>klicken …</translation>
    </message>
    <message>
        <source>Double click or Space: for the fit, or for the check</source>
        <translation>Doppelklick oder Leertaste: für die Ausgleichung oder zur Prüfung</translation>
    </message>
    <message>
        <source>Help: photomap in QGIS</source>
        <translation>Hilfe: photomap in QGIS</translation>
    </message>
    <message>
        <source>The help page is missing: install the plugin again from its zip.</source>
        <translation>Die Hilfeseite fehlt: installieren Sie das Plugin neu aus seiner ZIP-Datei.</translation>
    </message>
    <message>
        <source>The replaced layer is back.</source>
        <translation>Der ersetzte Layer ist wieder da.</translation>
    </message>
    <message>
        <source>Choose the new map in the layer tree (ticked), then swipe it away.</source>
        <translation>Wählen Sie die neue Karte im Layerbaum (angehakt), dann lässt sie sich wegwischen.</translation>
    </message>
    <message>
        <source>The layer's group has been removed from the project: nothing was put back.</source>
        <translation>Die Gruppe des Layers wurde aus dem Projekt entfernt: nichts wurde zurückgelegt.</translation>
    </message>
    <message>
        <source>Progress</source>
        <translation>Fortschritt</translation>
    </message>
    <message>
        <source>&amp;Cancel</source>
        <translation>&amp;Abbrechen</translation>
    </message>
    <message>
        <source>Stopping…</source>
        <translation>Wird angehalten …</translation>
    </message>
    <message>
        <source>{} left</source>
        <translation>noch {}</translation>
    </message>
    <message>
        <source>Finds</source>
        <translation>Funde</translation>
    </message>
    <message>
        <source>Track</source>
        <translation>Flugweg</translation>
    </message>
    <message>
        <source>Cameras</source>
        <translation>Kameras</translation>
    </message>
    <message>
        <source>Footprints of the frames</source>
        <translation>Bildflächen</translation>
    </message>
    <message>
        <source>Accuracy: one sigma of the place</source>
        <translation>Genauigkeit: ein Sigma des Ortes</translation>
    </message>
    <message>
        <source>Age: when last seen</source>
        <translation>Alter: wann zuletzt gesehen</translation>
    </message>
    <message>
        <source>Searched: smallest detail that shows</source>
        <translation>Abgesucht: kleinste sichtbare Einzelheit</translation>
    </message>
    <message>
        <source>Views: how many frames saw it</source>
        <translation>Ansichten: wie viele Bilder es zeigen</translation>
    </message>
    <message>
        <source>Changed areas</source>
        <translation>Geänderte Flächen</translation>
    </message>
    <message>
        <source>Map</source>
        <translation>Karte</translation>
    </message>
    <message>
        <source>What is known of each pixel</source>
        <translation>Was von jedem Pixel bekannt ist</translation>
    </message>
    <message>
        <source>Map, piece {}</source>
        <translation>Karte, Teil {}</translation>
    </message>
    <message>
        <source>The map has no place on Earth yet: it comes here once it has; see the page meanwhile.</source>
        <translation>Die Karte hat noch keinen Ort auf der Erde: sie kommt hierher, sobald sie einen hat; bis dahin zeigt sie die Seite.</translation>
    </message>
    <message>
        <source>photomap live: the link is lost</source>
        <translation>photomap live: die Verbindung ist verloren</translation>
    </message>
    <message>
        <source>Say where the pictures come from, and into which folder the map goes.</source>
        <translation>Sagen Sie, woher die Bilder kommen und in welchen Ordner die Karte geht.</translation>
    </message>
    <message>
        <source>A session that was started here still runs: end it first.</source>
        <translation>Eine hier gestartete Sitzung läuft noch: beenden Sie sie zuerst.</translation>
    </message>
    <message>
        <source>under the cursor ±{} m</source>
        <translation>unter dem Zeiger ±{} m</translation>
    </message>
    <message>
        <source>Marked: {}</source>
        <translation>Markiert: {}</translation>
    </message>
    <message>
        <source>The flight's mission is finished: {}. The dock Photo map has it among the recent missions.</source>
        <translation>Die Mission des Fluges ist fertig: {}. Das Fenster Fotokarte führt sie unter den letzten Missionen.</translation>
    </message>
    <message>
        <source>The link to {} is there again.</source>
        <translation>Die Verbindung zu {} ist wieder da.</translation>
    </message>
    <message>
        <source>{} It is tried again.</source>
        <translation>{} Es wird erneut versucht.</translation>
    </message>
    <message>
        <source>The flight has ended; its map is a mission now. {}</source>
        <translation>Der Flug ist zu Ende; seine Karte ist jetzt eine Mission. {}</translation>
    </message>
    <message>
        <source>The map lies in its place now.</source>
        <translation>Die Karte liegt jetzt an ihrem Ort.</translation>
    </message>
    <message>
        <source>photomap live</source>
        <translation>photomap live</translation>
    </message>
    <message>
        <source>Drone</source>
        <translation>Drohne</translation>
    </message>
    <message>
        <source>Accuracy here (CE90)</source>
        <translation>Genauigkeit hier (CE90)</translation>
    </message>
    <message>
        <source>What the camera sees</source>
        <translation>Was die Kamera sieht</translation>
    </message>
    <message>
        <source>Area to cover</source>
        <translation>Abzudeckende Fläche</translation>
    </message>
    <message>
        <source>Not seen yet</source>
        <translation>Noch nicht gesehen</translation>
    </message>
    <message>
        <source>Address of the session</source>
        <translation>Adresse der Sitzung</translation>
    </message>
    <message>
        <source>&amp;Connect</source>
        <translation>&amp;Verbinden</translation>
    </message>
    <message>
        <source>&amp;Follow the drone</source>
        <translation>Der Drohne &amp;folgen</translation>
    </message>
    <message>
        <source>Open the &amp;page</source>
        <translation>&amp;Seite öffnen</translation>
    </message>
    <message>
        <source>note</source>
        <translation>Notiz</translation>
    </message>
    <message>
        <source>&amp;Mark a find</source>
        <translation>Fund &amp;markieren</translation>
    </message>
    <message>
        <source>Then click its place on the map; Esc leaves</source>
        <translation>Dann seinen Ort in der Karte klicken; Esc beendet</translation>
    </message>
    <message>
        <source>Start a session</source>
        <translation>Sitzung starten</translation>
    </message>
    <message>
        <source>rtsp://…, udp://…, a video, a folder that is being filled</source>
        <translation>rtsp://…, udp://…, ein Video, ein Ordner, der gefüllt wird</translation>
    </message>
    <message>
        <source>&amp;Source</source>
        <translation>&amp;Quelle</translation>
    </message>
    <message>
        <source>Positions from the autopilot; leave it empty where the source brings its own</source>
        <translation>Positionen vom Autopiloten; leer lassen, wo die Quelle eigene mitbringt</translation>
    </message>
    <message>
        <source>&amp;Into</source>
        <translation>&amp;Nach</translation>
    </message>
    <message>
        <source>St&amp;art</source>
        <translation>St&amp;arten</translation>
    </message>
    <message>
        <source>Again: end the flight</source>
        <translation>Nochmals: Flug beenden</translation>
    </message>
    <message>
        <source>&amp;End and finalise</source>
        <translation>&amp;Beenden und fertigstellen</translation>
    </message>
    <message>
        <source>Dis&amp;connect</source>
        <translation>&amp;Trennen</translation>
    </message>
    <message>
        <source>victim</source>
        <translation>Opfer</translation>
    </message>
    <message>
        <source>intruder</source>
        <translation>Eindringling</translation>
    </message>
    <message>
        <source>hazard card</source>
        <translation>Gefahrentafel</translation>
    </message>
    <message>
        <source>other</source>
        <translation>anderes</translation>
    </message>
    <message>
        <source>All is well.</source>
        <translation>Alles in Ordnung.</translation>
    </message>
    <message>
        <source>GPS</source>
        <translation>GPS</translation>
    </message>
    <message>
        <source>no GPS now</source>
        <translation>jetzt kein GPS</translation>
    </message>
    <message>
        <source>GPS is looking</source>
        <translation>GPS sucht</translation>
    </message>
    <message>
        <source>without GPS</source>
        <translation>ohne GPS</translation>
    </message>
    <message>
        <source>The flight has ended.</source>
        <translation>Der Flug ist zu Ende.</translation>
    </message>
    <message>
        <source>The final map is being made.</source>
        <translation>Die endgültige Karte wird erstellt.</translation>
    </message>
    <message>
        <source>{fps} pictures/s, {latency} ms behind, {frames} pictures, {dropped} dropped</source>
        <translation>{fps} Bilder/s, {latency} ms zurück, {frames} Bilder, {dropped} ausgelassen</translation>
    </message>
    <message>
        <source>{} m high</source>
        <translation>{} m hoch</translation>
    </message>
    <message>
        <source>battery {} %</source>
        <translation>Akku {} %</translation>
    </message>
    <message>
        <source>Waiting for the first picture…</source>
        <translation>Warten auf das erste Bild …</translation>
    </message>
    <message>
        <source>{} broken</source>
        <translation>{} defekt</translation>
    </message>
    <message>
        <source>{} pieces</source>
        <translation>{} Teile</translation>
    </message>
    <message>
        <source>accuracy here ±{} m (CE90)</source>
        <translation>Genauigkeit hier ±{} m (CE90)</translation>
    </message>
    <message>
        <source>{} % of the area seen</source>
        <translation>{} % der Fläche gesehen</translation>
    </message>
    <message>
        <source>{} ha seen</source>
        <translation>{} ha gesehen</translation>
    </message>
    <message>
        <source>&amp;Make the map</source>
        <translation>Karte &amp;erstellen</translation>
    </message>
    <message>
        <source>{} more warnings stand in the log panel “photomap”.</source>
        <translation>{} weitere Warnungen stehen im Protokoll „photomap“.</translation>
    </message>
    <message>
        <source>Choose a mission's folder</source>
        <translation>Ordner einer Mission wählen</translation>
    </message>
    <message>
        <source>There is a mission in this folder: the same photos go on where it stopped.</source>
        <translation>In diesem Ordner ist eine Mission: dieselben Fotos machen weiter, wo sie aufgehört hat.</translation>
    </message>
    <message>
        <source>New map</source>
        <translation>Neue Karte</translation>
    </message>
    <message>
        <source>Recent missions</source>
        <translation>Letzte Missionen</translation>
    </message>
    <message>
        <source>Writing track and footprints…</source>
        <translation>Flugweg und Bildflächen werden geschrieben …</translation>
    </message>
    <message>
        <source>Stopped. The same photos into the same folder go on from there.</source>
        <translation>Angehalten. Dieselben Fotos in denselben Ordner machen dort weiter.</translation>
    </message>
    <message>
        <source>Help</source>
        <translation>Hilfe</translation>
    </message>
    <message>
        <source>A map is being made: wait for it, or cancel it.</source>
        <translation>Eine Karte wird gerade erstellt: warten oder abbrechen.</translation>
    </message>
    <message>
        <source>{} of {} frames are in the map.</source>
        <translation>{} von {} Bildern sind in der Karte.</translation>
    </message>
    <message>
        <source>“{}” has no place on Earth: pick two points of it in the dock “Georeference”.</source>
        <translation>„{}“ hat keinen Ort auf der Erde: wählen Sie zwei Punkte im Fenster „Georeferenzieren“.</translation>
    </message>
    <message>
        <source>as fine as the camera saw</source>
        <translation>so fein, wie die Kamera sah</translation>
    </message>
    <message>
        <source>automatic: the UTM zone</source>
        <translation>automatisch: die UTM-Zone</translation>
    </message>
    <message>
        <source>found from the pictures</source>
        <translation>aus den Bildern bestimmt</translation>
    </message>
    <message>
        <source>none: the positions of the photos alone</source>
        <translation>keine: nur die Positionen der Fotos</translation>
    </message>
    <message>
        <source>known by photo or drone</source>
        <translation>bekannt aus Foto oder Drohne</translation>
    </message>
    <message>
        <source>&amp;Layers of accuracy, age and what was searched</source>
        <translation>&amp;Layer für Genauigkeit, Alter und Abgesuchtes</translation>
    </message>
    <message>
        <source>Choose a folder of photos, photos, or a video.</source>
        <translation>Wählen Sie einen Ordner mit Fotos, Fotos oder ein Video.</translation>
    </message>
    <message>
        <source>Choose the folder in which the map is made.</source>
        <translation>Wählen Sie den Ordner, in dem die Karte entsteht.</translation>
    </message>
    <message>
        <source>&amp;Track log</source>
        <translation>&amp;Flugprotokoll</translation>
    </message>
    <message>
        <source>Map f&amp;older</source>
        <translation>Karten&amp;ordner</translation>
    </message>
    <message>
        <source>Options</source>
        <translation>Optionen</translation>
    </message>
    <message>
        <source>&amp;Pixel of the map</source>
        <translation>&amp;Pixel der Karte</translation>
    </message>
    <message>
        <source>&amp;Show</source>
        <translation>&amp;Zeigen</translation>
    </message>
    <message>
        <source>&amp;Elevation model</source>
        <translation>&amp;Höhenmodell</translation>
    </message>
    <message>
        <source>Lay on &amp;imagery</source>
        <translation>Auf &amp;Bilddaten legen</translation>
    </message>
    <message>
        <source>&amp;Ground control</source>
        <translation>&amp;Passpunkte</translation>
    </message>
    <message>
        <source>Chec&amp;k points</source>
        <translation>Pr&amp;üfpunkte</translation>
    </message>
    <message>
        <source>Field of vie&amp;w</source>
        <translation>Bild&amp;winkel</translation>
    </message>
    <message>
        <source>the frame that looks down most steeply</source>
        <translation>das Bild mit dem steilsten Blick</translation>
    </message>
    <message>
        <source>the sharpest frame</source>
        <translation>das schärfste Bild</translation>
    </message>
    <message>
        <source>the newest frame</source>
        <translation>das neueste Bild</translation>
    </message>
    <message>
        <source>{} is not there: remove it, or choose it again.</source>
        <translation>{} ist nicht da: entfernen oder neu wählen.</translation>
    </message>
    <message>
        <source>{} is a file: choose a folder for the map.</source>
        <translation>{} ist eine Datei: wählen Sie einen Ordner für die Karte.</translation>
    </message>
    <message>
        <source>{} holds other files: choose a new or empty folder for the map.</source>
        <translation>{} enthält andere Dateien: wählen Sie einen neuen oder leeren Ordner für die Karte.</translation>
    </message>
    <message>
        <source>Track logs</source>
        <translation>Flugprotokolle</translation>
    </message>
    <message>
        <source>The layer “{}” is no file on this machine: export it as a GeoTIFF first.</source>
        <translation>Der Layer „{}“ ist keine Datei auf diesem Rechner: zuerst als GeoTIFF exportieren.</translation>
    </message>
    <message>
        <source>&amp;Add to project</source>
        <translation>Zum Projekt &amp;hinzufügen</translation>
    </message>
    <message>
        <source>E&amp;xport…</source>
        <translation>E&amp;xportieren …</translation>
    </message>
    <message>
        <source>&amp;Georeference…</source>
        <translation>&amp;Georeferenzieren …</translation>
    </message>
    <message>
        <source>Forg&amp;et</source>
        <translation>&amp;Vergessen</translation>
    </message>
    <message>
        <source>Other &amp;mission…</source>
        <translation>Andere &amp;Mission …</translation>
    </message>
    <message>
        <source>Photos or video</source>
        <translation>Fotos oder Video</translation>
    </message>
    <message>
        <source>Photo &amp;folder…</source>
        <translation>&amp;Fotoordner …</translation>
    </message>
    <message>
        <source>Photos or &amp;video…</source>
        <translation>Fotos oder &amp;Video …</translation>
    </message>
    <message>
        <source>Choose a folder of photos</source>
        <translation>Ordner mit Fotos wählen</translation>
    </message>
    <message>
        <source>Choose photos or videos</source>
        <translation>Fotos oder Videos wählen</translation>
    </message>
    <message>
        <source>Photos and videos</source>
        <translation>Fotos und Videos</translation>
    </message>
    <message>
        <source>The engine gave no reason: see the log panel “photomap”.</source>
        <translation>Die Engine nannte keinen Grund: siehe Protokoll „photomap“.</translation>
    </message>
    <message>
        <source>Mission</source>
        <translation>Mission</translation>
    </message>
    <message>
        <source>&amp;Other…</source>
        <translation>&amp;Andere …</translation>
    </message>
    <message>
        <source>the engine's default</source>
        <translation>Vorgabe der Engine</translation>
    </message>
    <message>
        <source>&amp;Leave the engine running when QGIS closes</source>
        <translation>Engine weiter&amp;laufen lassen, wenn QGIS schließt</translation>
    </message>
    <message>
        <source>&amp;Find the engine</source>
        <translation>Engine &amp;suchen</translation>
    </message>
    <message>
        <source>&amp;Environment of the engine</source>
        <translation>&amp;Umgebung der Engine</translation>
    </message>
    <message>
        <source>or the &amp;program itself</source>
        <translation>oder das &amp;Programm selbst</translation>
    </message>
    <message>
        <source>&amp;Memory while a map is drawn</source>
        <translation>&amp;Speicher beim Zeichnen einer Karte</translation>
    </message>
    <message>
        <source>F&amp;older of new missions</source>
        <translation>&amp;Ordner neuer Missionen</translation>
    </message>
    <message>
        <source>An area needs three corners at least: click them one after the other.</source>
        <translation>Eine Fläche braucht mindestens drei Ecken: klicken Sie eine nach der anderen.</translation>
    </message>
    <message>
        <source>A line needs two corners at least: click where it begins and where it turns.</source>
        <translation>Eine Linie braucht mindestens zwei Ecken: klicken Sie, wo sie beginnt und wo sie abbiegt.</translation>
    </message>
    <message>
        <source>&amp;Draw</source>
        <translation>&amp;Zeichnen</translation>
    </message>
    <message>
        <source>Click the corners; right click or Enter closes, Backspace takes one back, Esc begins anew. Then drag corners, or the crosses between them; a right click on a corner takes it away.</source>
        <translation>Ecken klicken; Rechtsklick oder Enter schließt, Rücktaste nimmt eine zurück, Esc beginnt neu. Danach Ecken oder die Kreuze dazwischen ziehen; ein Rechtsklick auf eine Ecke entfernt sie.</translation>
    </message>
    <message>
        <source>&amp;Take selected</source>
        <translation>Auswahl über&amp;nehmen</translation>
    </message>
    <message>
        <source>The selected features of the active layer, in any CRS</source>
        <translation>Die ausgewählten Objekte des aktiven Layers, in jedem KBS</translation>
    </message>
    <message>
        <source>Set ta&amp;ke-off</source>
        <translation>&amp;Startplatz setzen</translation>
    </message>
    <message>
        <source>Set datu&amp;m</source>
        <translation>Bezugs&amp;punkt setzen</translation>
    </message>
    <message>
        <source>Where a search pattern begins</source>
        <translation>Wo ein Suchmuster beginnt</translation>
    </message>
    <message>
        <source>Clear</source>
        <translation>Leeren</translation>
    </message>
    <message>
        <source>Sa&amp;ve the plan…</source>
        <translation>Plan &amp;speichern …</translation>
    </message>
    <message>
        <source>Draw the area to fly over, or take the selected feature of a polygon layer.</source>
        <translation>Zeichnen Sie die zu befliegende Fläche, oder übernehmen Sie das ausgewählte Objekt eines Polygonlayers.</translation>
    </message>
    <message>
        <source>Set the search's datum by a click on the map.</source>
        <translation>Setzen Sie den Bezugspunkt der Suche durch einen Klick in die Karte.</translation>
    </message>
    <message>
        <source>Draw the line to fly along, or take the selected feature of a line layer.</source>
        <translation>Zeichnen Sie die abzufliegende Linie, oder übernehmen Sie das ausgewählte Objekt eines Linienlayers.</translation>
    </message>
    <message>
        <source>Save the plan</source>
        <translation>Plan speichern</translation>
    </message>
    <message>
        <source>Vehicle</source>
        <translation>Fluggerät</translation>
    </message>
    <message>
        <source>Saved: {}</source>
        <translation>Gespeichert: {}</translation>
    </message>
    <message>
        <source>The plan has {} sorties now: choose which one to upload.</source>
        <translation>Der Plan hat jetzt {} Flüge: wählen Sie, welcher hochgeladen wird.</translation>
    </message>
    <message>
        <source>it is not sound</source>
        <translation>er ist fehlerhaft</translation>
    </message>
    <message>
        <source>Choose a vector layer in the layer panel first: its selected feature is taken.</source>
        <translation>Wählen Sie zuerst einen Vektorlayer im Layerfenster: sein ausgewähltes Objekt wird übernommen.</translation>
    </message>
    <message>
        <source>“{}” holds no lines: choose a line layer, or draw the line.</source>
        <translation>„{}“ enthält keine Linien: wählen Sie einen Linienlayer oder zeichnen Sie die Linie.</translation>
    </message>
    <message>
        <source>“{}” holds no polygons: choose a polygon layer, or draw the area.</source>
        <translation>„{}“ enthält keine Polygone: wählen Sie einen Polygonlayer oder zeichnen Sie die Fläche.</translation>
    </message>
    <message>
        <source>Feature {} is not valid ({}): the planner repairs it where that is safe; look at the result.</source>
        <translation>Objekt {} ist ungültig ({}): der Planer repariert es, wo das sicher ist; prüfen Sie das Ergebnis.</translation>
    </message>
    <message>
        <source>Nothing is selected in “{}”: select the feature to fly over, and press this again.</source>
        <translation>In „{}“ ist nichts ausgewählt: wählen Sie das zu befliegende Objekt und drücken Sie erneut.</translation>
    </message>
    <message>
        <source>“{}” has no CRS, so its place is not known: set it in the layer's properties.</source>
        <translation>„{}“ hat kein KBS, sein Ort ist also unbekannt: in den Layereigenschaften setzen.</translation>
    </message>
    <message>
        <source>“{}” has more than {} features: select those that matter.</source>
        <translation>„{}“ hat mehr als {} Objekte: wählen Sie die wichtigen aus.</translation>
    </message>
    <message>
        <source>Feature {} has no geometry and is left out.</source>
        <translation>Objekt {} hat keine Geometrie und wird ausgelassen.</translation>
    </message>
    <message>
        <source>“{}” has more than {} corners: simplify it first.</source>
        <translation>„{}“ hat mehr als {} Ecken: zuerst vereinfachen.</translation>
    </message>
    <message>
        <source>Feature {} of “{}” has no place on Earth: is the layer's CRS ({}) right?</source>
        <translation>Objekt {} von „{}“ hat keinen Ort auf der Erde: stimmt das KBS des Layers ({})?</translation>
    </message>
    <message>
        <source>Nothing is left of “{}” to fly over.</source>
        <translation>Von „{}“ bleibt nichts zu befliegen.</translation>
    </message>
    <message>
        <source>What</source>
        <translation>Was</translation>
    </message>
    <message>
        <source>&amp;Flight</source>
        <translation>&amp;Flug</translation>
    </message>
    <message>
        <source>Width of the strip</source>
        <translation>Breite des Streifens</translation>
    </message>
    <message>
        <source>Radius</source>
        <translation>Radius</translation>
    </message>
    <message>
        <source>A polygon layer, any CRS: never fly over its features.</source>
        <translation>Ein Polygonlayer, beliebiges KBS: seine Objekte werden nie überflogen.</translation>
    </message>
    <message>
        <source>&amp;No-fly areas</source>
        <translation>Flug&amp;verbotsflächen</translation>
    </message>
    <message>
        <source>Never leave the area</source>
        <translation>Die Fläche nie verlassen</translation>
    </message>
    <message>
        <source>Camera</source>
        <translation>Kamera</translation>
    </message>
    <message>
        <source>A one-inch mapping camera (assumed)</source>
        <translation>Eine Ein-Zoll-Kartierkamera (angenommen)</translation>
    </message>
    <message>
        <source>By numbers…</source>
        <translation>Nach Zahlen …</translation>
    </message>
    <message>
        <source>&amp;Camera</source>
        <translation>&amp;Kamera</translation>
    </message>
    <message>
        <source>Horizontal view</source>
        <translation>Bildwinkel waagerecht</translation>
    </message>
    <message>
        <source>Picture</source>
        <translation>Bild</translation>
    </message>
    <message>
        <source>Height &amp;by</source>
        <translation>&amp;Höhe nach</translation>
    </message>
    <message>
        <source>&amp;Overlap front, side</source>
        <translation>&amp;Überlappung längs, quer</translation>
    </message>
    <message>
        <source>Flight</source>
        <translation>Flug</translation>
    </message>
    <message>
        <source>&amp;Speed</source>
        <translation>&amp;Geschwindigkeit</translation>
    </message>
    <message>
        <source>no wind</source>
        <translation>kein Wind</translation>
    </message>
    <message>
        <source>Where the wind comes from, clockwise from north</source>
        <translation>Woher der Wind kommt, im Uhrzeigersinn ab Nord</translation>
    </message>
    <message>
        <source>&amp;Wind, from</source>
        <translation>&amp;Wind, aus</translation>
    </message>
    <message>
        <source>one flight</source>
        <translation>ein Flug</translation>
    </message>
    <message>
        <source>What one battery flies: the plan is split into sorties</source>
        <translation>Was ein Akku fliegt: der Plan wird in Flüge geteilt</translation>
    </message>
    <message>
        <source>&amp;Battery</source>
        <translation>&amp;Akku</translation>
    </message>
    <message>
        <source>the fastest</source>
        <translation>die schnellste</translation>
    </message>
    <message>
        <source>&amp;Lanes' heading</source>
        <translation>&amp;Richtung der Bahnen</translation>
    </message>
    <message>
        <source>as the survey</source>
        <translation>wie die Aufnahme</translation>
    </message>
    <message>
        <source>Height on the &amp;way</source>
        <translation>Höhe auf dem &amp;Weg</translation>
    </message>
    <message>
        <source>returns (RTL)</source>
        <translation>kehrt zurück (RTL)</translation>
    </message>
    <message>
        <source>lands at home</source>
        <translation>landet am Startplatz</translation>
    </message>
    <message>
        <source>At the &amp;end</source>
        <translation>Am &amp;Ende</translation>
    </message>
    <message>
        <source>&amp;Autopilot</source>
        <translation>Auto&amp;pilot</translation>
    </message>
    <message>
        <source>Terrain</source>
        <translation>Gelände</translation>
    </message>
    <message>
        <source>flat ground</source>
        <translation>ebener Boden</translation>
    </message>
    <message>
        <source>An elevation model from a file: the flight keeps its height above the ground.</source>
        <translation>Ein Höhenmodell aus einer Datei: der Flug hält seine Höhe über Grund.</translation>
    </message>
    <message>
        <source>&amp;Elevation layer</source>
        <translation>&amp;Höhenlayer</translation>
    </message>
    <message>
        <source>Heights are above</source>
        <translation>Höhen sind über</translation>
    </message>
    <message>
        <source>Geoid's height</source>
        <translation>Geoidhöhe</translation>
    </message>
    <message>
        <source>Cover the area</source>
        <translation>Fläche abdecken</translation>
    </message>
    <message>
        <source>Cover the area twice, crosswise</source>
        <translation>Fläche zweimal abdecken, kreuzweise</translation>
    </message>
    <message>
        <source>A strip along a line</source>
        <translation>Ein Streifen entlang einer Linie</translation>
    </message>
    <message>
        <source>Search: expanding square (SS)</source>
        <translation>Suche: wachsendes Quadrat (SS)</translation>
    </message>
    <message>
        <source>Search: sectors (VS)</source>
        <translation>Suche: Sektoren (VS)</translation>
    </message>
    <message>
        <source>Search: parallel tracks (PS)</source>
        <translation>Suche: parallele Bahnen (PS)</translation>
    </message>
    <message>
        <source>Search: creeping line (CS)</source>
        <translation>Suche: kriechende Linie (CS)</translation>
    </message>
    <message>
        <source>Search: along a track (TSR)</source>
        <translation>Suche: entlang einer Strecke (TSR)</translation>
    </message>
    <message>
        <source>Search: spiral</source>
        <translation>Suche: Spirale</translation>
    </message>
    <message>
        <source>Circles about a place</source>
        <translation>Kreise um einen Ort</translation>
    </message>
    <message>
        <source>Along the area's rim</source>
        <translation>Am Rand der Fläche entlang</translation>
    </message>
    <message>
        <source>What must be seen</source>
        <translation>Was zu sehen sein muss</translation>
    </message>
    <message>
        <source>Ground pixel (GSD)</source>
        <translation>Bodenpixel (GSD)</translation>
    </message>
    <message>
        <source>Height above ground</source>
        <translation>Höhe über Grund</translation>
    </message>
    <message>
        <source>a hazard card, 40 x 30 cm</source>
        <translation>eine Gefahrentafel, 40 x 30 cm</translation>
    </message>
    <message>
        <source>a person</source>
        <translation>eine Person</translation>
    </message>
    <message>
        <source>a vehicle</source>
        <translation>ein Fahrzeug</translation>
    </message>
    <message>
        <source>of this size:</source>
        <translation>von dieser Größe:</translation>
    </message>
    <message>
        <source>as the file says</source>
        <translation>wie die Datei sagt</translation>
    </message>
    <message>
        <source>mean sea level</source>
        <translation>Meeresspiegel</translation>
    </message>
    <message>
        <source>the ellipsoid</source>
        <translation>Ellipsoid</translation>
    </message>
    <message>
        <source>“{}” is not a raster file: export it as GeoTIFF (Layer, Save As), and choose that.</source>
        <translation>„{}“ ist keine Rasterdatei: als GeoTIFF exportieren (Layer, Speichern als) und dieses wählen.</translation>
    </message>
    <message>
        <source>photomap flight plan</source>
        <translation>photomap-Flugplan</translation>
    </message>
    <message>
        <source>photomap vehicle</source>
        <translation>photomap-Fluggerät</translation>
    </message>
    <message>
        <source>Take-off</source>
        <translation>Start</translation>
    </message>
    <message>
        <source>Waypoints</source>
        <translation>Wegpunkte</translation>
    </message>
    <message>
        <source>Flight path</source>
        <translation>Flugweg</translation>
    </message>
    <message>
        <source>Camera on</source>
        <translation>Kamera an</translation>
    </message>
    <message>
        <source>Not sure to be seen</source>
        <translation>Nicht sicher zu sehen</translation>
    </message>
    <message>
        <source>No-fly areas</source>
        <translation>Flugverbotsflächen</translation>
    </message>
    <message>
        <source>Area</source>
        <translation>Fläche</translation>
    </message>
    <message>
        <source>Photo footprints</source>
        <translation>Bildflächen der Fotos</translation>
    </message>
    <message>
        <source>Sure to be seen</source>
        <translation>Sicher zu sehen</translation>
    </message>
    <message>
        <source>Stored items</source>
        <translation>Gespeicherte Punkte</translation>
    </message>
    <message>
        <source>Stored route</source>
        <translation>Gespeicherte Route</translation>
    </message>
    <message>
        <source>Stored fence</source>
        <translation>Gespeicherter Zaun</translation>
    </message>
    <message>
        <source>The plan's drawing cannot be read: {}</source>
        <translation>Die Zeichnung des Plans ist nicht lesbar: {}</translation>
    </message>
    <message>
        <source>sure to be seen</source>
        <translation>sicher zu sehen</translation>
    </message>
    <message>
        <source>of the area swept</source>
        <translation>der Fläche abgesucht</translation>
    </message>
    <message>
        <source>margin</source>
        <translation>Rand</translation>
    </message>
    <message>
        <source>camera</source>
        <translation>Kamera</translation>
    </message>
    <message>
        <source>“Width of the strip”</source>
        <translation>„Breite des Streifens“</translation>
    </message>
    <message>
        <source>an elevation layer</source>
        <translation>ein Höhenlayer</translation>
    </message>
    <message>
        <source>“Battery”</source>
        <translation>„Akku“</translation>
    </message>
    <message>
        <source>“Horizontal view”</source>
        <translation>„Bildwinkel waagerecht“</translation>
    </message>
    <message>
        <source>front overlap</source>
        <translation>Längsüberlappung</translation>
    </message>
    <message>
        <source>“Geoid's height”</source>
        <translation>„Geoidhöhe“</translation>
    </message>
    <message>
        <source>“Heights are above”</source>
        <translation>„Höhen sind über“</translation>
    </message>
    <message>
        <source>ground pixel</source>
        <translation>Bodenpixel</translation>
    </message>
    <message>
        <source>height</source>
        <translation>Höhe</translation>
    </message>
    <message>
        <source>take-off place</source>
        <translation>Startplatz</translation>
    </message>
    <message>
        <source>“Never leave the area”</source>
        <translation>„Die Fläche nie verlassen“</translation>
    </message>
    <message>
        <source>side overlap</source>
        <translation>Querüberlappung</translation>
    </message>
    <message>
        <source>speed</source>
        <translation>Geschwindigkeit</translation>
    </message>
    <message>
        <source>target</source>
        <translation>Ziel</translation>
    </message>
    <message>
        <source>height on the way</source>
        <translation>Höhe auf dem Weg</translation>
    </message>
    <message>
        <source>{} min</source>
        <translation>{} min</translation>
    </message>
    <message>
        <source>{minutes} in {sorties}, {photos} photos, {km} km</source>
        <translation>{minutes} in {sorties}, {photos} Fotos, {km} km</translation>
    </message>
    <message>
        <source>Verified: the vehicle holds this plan, read back item by item.</source>
        <translation>Geprüft: das Fluggerät hat diesen Plan, Punkt für Punkt zurückgelesen.</translation>
    </message>
    <message>
        <source>Not taken over: the vehicle's mission of before was put back and read back.</source>
        <translation>Nicht übernommen: die frühere Mission des Fluggeräts wurde zurückgelegt und zurückgelesen.</translation>
    </message>
    <message>
        <source>Refused.</source>
        <translation>Abgelehnt.</translation>
    </message>
    <message>
        <source>Unknown: the vehicle did not answer. Do not fly before its mission was read.</source>
        <translation>Unbekannt: das Fluggerät hat nicht geantwortet. Nicht fliegen, bevor seine Mission gelesen wurde.</translation>
    </message>
    <message>
        <source>The vehicle holds a mixture: do not fly, put back what was there.</source>
        <translation>Das Fluggerät hat eine Mischung: nicht fliegen, das Frühere zurücklegen.</translation>
    </message>
    <message>
        <source>overlaps {front} / {side} %, {speed} m/s</source>
        <translation>Überlappungen {front} / {side} %, {speed} m/s</translation>
    </message>
    <message>
        <source>found with a probability of {random} % (random search), {cube} % (inverse cube)</source>
        <translation>gefunden mit Wahrscheinlichkeit {random} % (Zufallssuche), {cube} % (inverse dritte Potenz)</translation>
    </message>
    <message>
        <source>{} items.</source>
        <translation>{} Punkte.</translation>
    </message>
    <message>
        <source>What it held before: {}</source>
        <translation>Was es vorher hatte: {}</translation>
    </message>
    <message>
        <source>{} sorties</source>
        <translation>{} Flüge</translation>
    </message>
    <message>
        <source>udpin:0.0.0.0:14550 listens, udpout:HOST:PORT, tcp:HOST:PORT, serial:/dev/ttyUSB0:57600 or COM3</source>
        <translation>udpin:0.0.0.0:14550 horcht, udpout:HOST:PORT, tcp:HOST:PORT, serial:/dev/ttyUSB0:57600 oder COM3</translation>
    </message>
    <message>
        <source>Co&amp;nnection</source>
        <translation>Ver&amp;bindung</translation>
    </message>
    <message>
        <source>So&amp;rtie</source>
        <translation>Fl&amp;ug</translation>
    </message>
    <message>
        <source>An upload with an item higher above home is refused</source>
        <translation>Ein Hochladen mit einem höheren Punkt über dem Startplatz wird abgelehnt</translation>
    </message>
    <message>
        <source>An upload with an item farther from home is refused</source>
        <translation>Ein Hochladen mit einem weiter entfernten Punkt wird abgelehnt</translation>
    </message>
    <message>
        <source>Refuse above, beyond</source>
        <translation>Ablehnen über, jenseits</translation>
    </message>
    <message>
        <source>&amp;Upload</source>
        <translation>&amp;Hochladen</translation>
    </message>
    <message>
        <source>Show its &amp;mission</source>
        <translation>Seine &amp;Mission zeigen</translation>
    </message>
    <message>
        <source>&amp;Status</source>
        <translation>&amp;Zustand</translation>
    </message>
    <message>
        <source>Take off &amp;here</source>
        <translation>Hier st&amp;arten</translation>
    </message>
    <message>
        <source>&amp;Put back</source>
        <translation>Zurück&amp;legen</translation>
    </message>
    <message>
        <source>Stop</source>
        <translation>Anhalten</translation>
    </message>
    <message>
        <source>Uploading…</source>
        <translation>Wird hochgeladen …</translation>
    </message>
    <message>
        <source>Putting back…</source>
        <translation>Wird zurückgelegt …</translation>
    </message>
    <message>
        <source>Reading the vehicle's mission…</source>
        <translation>Die Mission des Fluggeräts wird gelesen …</translation>
    </message>
    <message>
        <source>Asking the vehicle…</source>
        <translation>Das Fluggerät wird gefragt …</translation>
    </message>
    <message>
        <source>{} m above home</source>
        <translation>{} m über dem Startplatz</translation>
    </message>
    <message>
        <source>{} satellites</source>
        <translation>{} Satelliten</translation>
    </message>
    <message>
        <source>Upload the chosen sortie, read it back, put the old mission back if it differs</source>
        <translation>Den gewählten Flug hochladen, zurücklesen, bei Abweichung die alte Mission zurücklegen</translation>
    </message>
    <message>
        <source>Read the mission that the vehicle holds, and show it on the map</source>
        <translation>Die Mission des Fluggeräts lesen und in der Karte zeigen</translation>
    </message>
    <message>
        <source>Plan the take-off where the vehicle stands</source>
        <translation>Den Start dort planen, wo das Fluggerät steht</translation>
    </message>
    <message>
        <source>Give the vehicle the mission again that the last upload replaced</source>
        <translation>Dem Fluggerät die Mission wiedergeben, die das letzte Hochladen ersetzt hat</translation>
    </message>
    <message>
        <source>Stopping: the vehicle is brought to a known state first…</source>
        <translation>Wird angehalten: das Fluggerät wird zuerst in einen bekannten Zustand gebracht …</translation>
    </message>
    <message>
        <source>{} cannot be made ({}): what the vehicle holds is kept in {} until QGIS closes.</source>
        <translation>{} kann nicht angelegt werden ({}): was das Fluggerät hat, wird in {} behalten, bis QGIS schließt.</translation>
    </message>
    <message>
        <source>Say how the vehicle is connected, as udpin:0.0.0.0:14550 or serial:COM3:57600.</source>
        <translation>Sagen Sie, wie das Fluggerät verbunden ist, etwa udpin:0.0.0.0:14550 oder serial:COM3:57600.</translation>
    </message>
    <message>
        <source>The vehicle holds {items} items, {fence} of a fence, {rally} rally points.</source>
        <translation>Das Fluggerät hat {items} Punkte, {fence} eines Zauns, {rally} Sammelpunkte.</translation>
    </message>
    <message>
        <source>None of them has a place to show.</source>
        <translation>Keiner davon hat einen Ort zu zeigen.</translation>
    </message>
    <message>
        <source>The vehicle does not know where it is yet: wait for its GPS.</source>
        <translation>Das Fluggerät weiß noch nicht, wo es ist: warten Sie auf sein GPS.</translation>
    </message>
    <message>
        <source>ARMED</source>
        <translation>SCHARF</translation>
    </message>
    <message>
        <source>disarmed</source>
        <translation>gesichert</translation>
    </message>
    <message>
        <source>mission item {current} of {total}</source>
        <translation>Missionspunkt {current} von {total}</translation>
    </message>
    <message>
        <source>{} of {}</source>
        <translation>{} von {}</translation>
    </message>
    <message>
        <source>Vehicle {number}: {autopilot} {version}</source>
        <translation>Fluggerät {number}: {autopilot} {version}</translation>
    </message>
    <message>
        <source>unknown autopilot</source>
        <translation>unbekannter Autopilot</translation>
    </message>
    <message>
        <source>Photo map</source>
        <translation>Fotokarte</translation>
    </message>
    <message>
        <source>Flight planner</source>
        <translation>Flugplaner</translation>
    </message>
    <message>
        <source>Live map</source>
        <translation>Live-Karte</translation>
    </message>
    <message>
        <source>Georeference</source>
        <translation>Georeferenzieren</translation>
    </message>
    <message>
        <source>Settings…</source>
        <translation>Einstellungen …</translation>
    </message>
    <message>
        <source>Replace imagery…</source>
        <translation>Bilddaten ersetzen …</translation>
    </message>
    <message>
        <source>Undo the last replacement</source>
        <translation>Letztes Ersetzen rückgängig machen</translation>
    </message>
    <message>
        <source>Swipe the active layer</source>
        <translation>Aktiven Layer wegwischen</translation>
    </message>
    <message>
        <source>What has changed…</source>
        <translation>Was hat sich geändert …</translation>
    </message>
    <message>
        <source>This place cannot be said in degrees: choose a projection that reaches there.</source>
        <translation>Dieser Ort lässt sich nicht in Grad angeben: wählen Sie eine Projektion, die dorthin reicht.</translation>
    </message>
    <message>
        <source>Old imagery</source>
        <translation>Alte Bilddaten</translation>
    </message>
    <message>
        <source>Score from which ground has changed</source>
        <translation>Wert, ab dem sich der Boden geändert hat</translation>
    </message>
    <message>
        <source>Smallest area, square metres</source>
        <translation>Kleinste Fläche, Quadratmeter</translation>
    </message>
    <message>
        <source>Pixel of the comparison, metres (default: the coarser one's)</source>
        <translation>Pixel des Vergleichs, Meter (Vorgabe: das gröbere)</translation>
    </message>
    <message>
        <source>CRS of the comparison</source>
        <translation>KBS des Vergleichs</translation>
    </message>
    <message>
        <source>Number of changed areas</source>
        <translation>Anzahl geänderter Flächen</translation>
    </message>
    <message>
        <source>Changed ground, square metres</source>
        <translation>Geänderter Boden, Quadratmeter</translation>
    </message>
    <message>
        <source>Further options of the command, as JSON: {"workers": 2}</source>
        <translation>Weitere Optionen des Befehls, als JSON: {"workers": 2}</translation>
    </message>
    <message>
        <source>Further options: write a JSON object such as {"workers": 2}.</source>
        <translation>Weitere Optionen: schreiben Sie ein JSON-Objekt wie {"workers": 2}.</translation>
    </message>
    <message>
        <source>{}: {} is no raster that QGIS can read.</source>
        <translation>{}: {} ist kein Raster, das QGIS lesen kann.</translation>
    </message>
    <message>
        <source>Give the imagery another name than “procedural”.</source>
        <translation>Geben Sie den Bilddaten einen anderen Namen als „procedural“.</translation>
    </message>
    <message>
        <source>Never fly here</source>
        <translation>Hier nie fliegen</translation>
    </message>
    <message>
        <source>Camera, as FC6310 or Mavic 3E</source>
        <translation>Kamera, etwa FC6310 oder Mavic 3E</translation>
    </message>
    <message>
        <source>Ground sampling distance, metres a pixel</source>
        <translation>Bodenauflösung, Meter je Pixel</translation>
    </message>
    <message>
        <source>Height above ground, metres, instead</source>
        <translation>Stattdessen Höhe über Grund, Meter</translation>
    </message>
    <message>
        <source>What must be seen, instead (person, card, 0.4x0.3)</source>
        <translation>Stattdessen, was zu sehen sein muss (person, card, 0.4x0.3)</translation>
    </message>
    <message>
        <source>Front overlap, percent</source>
        <translation>Längsüberlappung, Prozent</translation>
    </message>
    <message>
        <source>Side overlap, percent</source>
        <translation>Querüberlappung, Prozent</translation>
    </message>
    <message>
        <source>Heading of the lanes, degrees (default: the fastest)</source>
        <translation>Richtung der Bahnen, Grad (Vorgabe: die schnellste)</translation>
    </message>
    <message>
        <source>Speed, metres a second</source>
        <translation>Geschwindigkeit, Meter je Sekunde</translation>
    </message>
    <message>
        <source>Wind: metres a second and where from, as 5,270</source>
        <translation>Wind: Meter je Sekunde und woher, etwa 5,270</translation>
    </message>
    <message>
        <source>Minutes that one battery flies</source>
        <translation>Minuten, die ein Akku fliegt</translation>
    </message>
    <message>
        <source>Take-off place</source>
        <translation>Startplatz</translation>
    </message>
    <message>
        <source>Elevation model: keep the height above it</source>
        <translation>Höhenmodell: Höhe darüber halten</translation>
    </message>
    <message>
        <source>A second sweep across the first</source>
        <translation>Eine zweite Abdeckung quer zur ersten</translation>
    </message>
    <message>
        <source>Autopilot</source>
        <translation>Autopilot</translation>
    </message>
    <message>
        <source>Plan</source>
        <translation>Plan</translation>
    </message>
    <message>
        <source>Lanes, footprints, coverage, waypoints</source>
        <translation>Bahnen, Bildflächen, Abdeckung, Wegpunkte</translation>
    </message>
    <message>
        <source>Share of the area that is sure to be seen</source>
        <translation>Anteil der Fläche, der sicher zu sehen ist</translation>
    </message>
    <message>
        <source>Time of flight in seconds</source>
        <translation>Flugzeit in Sekunden</translation>
    </message>
    <message>
        <source>Photos</source>
        <translation>Fotos</translation>
    </message>
    <message>
        <source>Sorties</source>
        <translation>Flüge</translation>
    </message>
    <message>
        <source>Plan (.plan or .waypoints)</source>
        <translation>Plan (.plan oder .waypoints)</translation>
    </message>
    <message>
        <source>Connection</source>
        <translation>Verbindung</translation>
    </message>
    <message>
        <source>System id, where several vehicles are on the link</source>
        <translation>System-ID, wo mehrere Fluggeräte an der Verbindung sind</translation>
    </message>
    <message>
        <source>Give up after so many seconds</source>
        <translation>Nach so vielen Sekunden aufgeben</translation>
    </message>
    <message>
        <source>Refuse items higher above home, metres</source>
        <translation>Höhere Punkte über dem Startplatz ablehnen, Meter</translation>
    </message>
    <message>
        <source>Refuse items farther from home, metres</source>
        <translation>Weiter entfernte Punkte ablehnen, Meter</translation>
    </message>
    <message>
        <source>Wait while the vehicle flies its mission</source>
        <translation>Warten, solange das Fluggerät seine Mission fliegt</translation>
    </message>
    <message>
        <source>Outcome</source>
        <translation>Ergebnis</translation>
    </message>
    <message>
        <source>Items</source>
        <translation>Punkte</translation>
    </message>
    <message>
        <source>What the vehicle held before</source>
        <translation>Was das Fluggerät vorher hatte</translation>
    </message>
    <message>
        <source>Photos, or frames of the video</source>
        <translation>Fotos oder Bilder des Videos</translation>
    </message>
    <message>
        <source>Height above ground, metres (default: the ground is filled)</source>
        <translation>Höhe über Grund, Meter (Vorgabe: der Boden wird gefüllt)</translation>
    </message>
    <message>
        <source>Width of a frame, pixels</source>
        <translation>Breite eines Bildes, Pixel</translation>
    </message>
    <message>
        <source>Height of a frame, pixels</source>
        <translation>Höhe eines Bildes, Pixel</translation>
    </message>
    <message>
        <source>A video instead of photos</source>
        <translation>Ein Video statt Fotos</translation>
    </message>
    <message>
        <source>Error of the GPS, metres</source>
        <translation>Fehler des GPS, Meter</translation>
    </message>
    <message>
        <source>Sigma of roll and pitch, degrees</source>
        <translation>Sigma von Rollen und Nicken, Grad</translation>
    </message>
    <message>
        <source>Seed: the same one gives the same flight</source>
        <translation>Startwert: derselbe gibt denselben Flug</translation>
    </message>
    <message>
        <source>Folder</source>
        <translation>Ordner</translation>
    </message>
    <message>
        <source>Photos, or the video</source>
        <translation>Fotos oder das Video</translation>
    </message>
    <message>
        <source>Pixel in metres</source>
        <translation>Pixel in Metern</translation>
    </message>
    <message>
        <source>Imagery to fly over</source>
        <translation>Zu überfliegende Bilddaten</translation>
    </message>
    <message>
        <source>“{}” is no file: save it as a GeoTIFF first (Layer &gt; Save As), and choose that.</source>
        <translation>„{}“ ist keine Datei: zuerst als GeoTIFF speichern (Layer &gt; Speichern als) und dieses wählen.</translation>
    </message>
    <message>
        <source>{}: the layer has no CRS, so its place is not known: set it in the layer's properties.</source>
        <translation>{}: der Layer hat kein KBS, sein Ort ist also unbekannt: in den Layereigenschaften setzen.</translation>
    </message>
    <message>
        <source>{}: there is no feature with a geometry.</source>
        <translation>{}: es gibt kein Objekt mit einer Geometrie.</translation>
    </message>
    <message>
        <source>{}: more than {} features: select those that matter.</source>
        <translation>{}: mehr als {} Objekte: wählen Sie die wichtigen aus.</translation>
    </message>
    <message>
        <source>{}: feature {} has no place on Earth: is the layer's CRS right?</source>
        <translation>{}: Objekt {} hat keinen Ort auf der Erde: stimmt das KBS des Layers?</translation>
    </message>
    <message>
        <source>Videos, or single photos</source>
        <translation>Videos oder einzelne Fotos</translation>
    </message>
    <message>
        <source>Add the result to the project</source>
        <translation>Ergebnis zum Projekt hinzufügen</translation>
    </message>
    <message>
        <source>Format</source>
        <translation>Format</translation>
    </message>
    <message>
        <source>JSON files (*.json)</source>
        <translation>JSON-Dateien (*.json)</translation>
    </message>
    <message>
        <source>Choose a folder of photos, or videos.</source>
        <translation>Wählen Sie einen Ordner mit Fotos, oder Videos.</translation>
    </message>
    <message>
        <source>Folder of photos</source>
        <translation>Ordner mit Fotos</translation>
    </message>
    <message>
        <source>Track log of the video, where none lies beside it</source>
        <translation>Flugprotokoll des Videos, wo keines daneben liegt</translation>
    </message>
    <message>
        <source>CRS of the map (default: the right UTM zone)</source>
        <translation>KBS der Karte (Vorgabe: die passende UTM-Zone)</translation>
    </message>
    <message>
        <source>Pixel of the map in metres (default: what the camera saw)</source>
        <translation>Pixel der Karte in Metern (Vorgabe: was die Kamera sah)</translation>
    </message>
    <message>
        <source>Heights of the ground</source>
        <translation>Höhen des Bodens</translation>
    </message>
    <message>
        <source>Ground control points (gcp_list.txt or CSV)</source>
        <translation>Passpunkte (gcp_list.txt oder CSV)</translation>
    </message>
    <message>
        <source>CRS of a CSV of control points that does not say</source>
        <translation>KBS einer CSV mit Passpunkten, die es nicht sagt</translation>
    </message>
    <message>
        <source>Check points: names with commas, or every-third</source>
        <translation>Prüfpunkte: Namen mit Kommas, oder every-third</translation>
    </message>
    <message>
        <source>Existing imagery to lay the map on</source>
        <translation>Vorhandene Bilddaten, auf die die Karte gelegt wird</translation>
    </message>
    <message>
        <source>Horizontal field of view, degrees</source>
        <translation>Waagerechter Bildwinkel, Grad</translation>
    </message>
    <message>
        <source>Of several frames show</source>
        <translation>Von mehreren Bildern zeigen</translation>
    </message>
    <message>
        <source>Write layers of accuracy, age and coverage too</source>
        <translation>Auch Layer für Genauigkeit, Alter und Abdeckung schreiben</translation>
    </message>
    <message>
        <source>Memory for pictures, MB</source>
        <translation>Speicher für Bilder, MB</translation>
    </message>
    <message>
        <source>Mission folder (a temporary one goes with QGIS)</source>
        <translation>Missionsordner (ein temporärer verschwindet mit QGIS)</translation>
    </message>
    <message>
        <source>Predicted CE90 in metres</source>
        <translation>Vorhergesagtes CE90 in Metern</translation>
    </message>
    <message>
        <source>Registered frames</source>
        <translation>Registrierte Bilder</translation>
    </message>
    <message>
        <source>Mission folder</source>
        <translation>Missionsordner</translation>
    </message>
    <message>
        <source>Only inside these polygons</source>
        <translation>Nur innerhalb dieser Polygone</translation>
    </message>
    <message>
        <source>CRS (default: the mission's)</source>
        <translation>KBS (Vorgabe: das der Mission)</translation>
    </message>
    <message>
        <source>Finest pixel, in units of the CRS</source>
        <translation>Feinstes Pixel, in Einheiten des KBS</translation>
    </message>
    <message>
        <source>Compression of the GeoTIFF</source>
        <translation>Kompression des GeoTIFF</translation>
    </message>
    <message>
        <source>Quality of JPEG and WEBP</source>
        <translation>Qualität von JPEG und WEBP</translation>
    </message>
    <message>
        <source>Replace the stale pixels of this layer</source>
        <translation>Die veralteten Pixel dieses Layers ersetzen</translation>
    </message>
    <message>
        <source>Finds (points) for ATAK and vectors</source>
        <translation>Funde (Punkte) für ATAK und Vektoren</translation>
    </message>
    <message>
        <source>Whom to credit</source>
        <translation>Wer zu nennen ist</translation>
    </message>
    <message>
        <source>File, or folder</source>
        <translation>Datei oder Ordner</translation>
    </message>
    <message>
        <source>All files (*.*)</source>
        <translation>Alle Dateien (*.*)</translation>
    </message>
    <message>
        <source>Raster layer</source>
        <translation>Rasterlayer</translation>
    </message>
    <message>
        <source>Vector layer</source>
        <translation>Vektorlayer</translation>
    </message>
    <message>
        <source>Largest size, such as 20MB</source>
        <translation>Größte Größe, etwa 20MB</translation>
    </message>
    <message>
        <source>Package</source>
        <translation>Paket</translation>
    </message>
    <message>
        <source>Zip files (*.zip)</source>
        <translation>ZIP-Dateien (*.zip)</translation>
    </message>
    <message>
        <source>Size in bytes</source>
        <translation>Größe in Bytes</translation>
    </message>
    <message>
        <source>Folder of photos, or a mission</source>
        <translation>Ordner mit Fotos, oder eine Mission</translation>
    </message>
    <message>
        <source>Report</source>
        <translation>Bericht</translation>
    </message>
    <message>
        <source>Report as JSON</source>
        <translation>Bericht als JSON</translation>
    </message>
    <message>
        <source>Formats:</source>
        <translation>Formate:</translation>
    </message>
    <message>
        <source>The report cannot be written to {}: {}; choose another file.</source>
        <translation>Der Bericht kann nicht nach {} geschrieben werden: {}; wählen Sie eine andere Datei.</translation>
    </message>
    <message>
        <source>photomap: photo maps from drones</source>
        <translation>photomap: Fotokarten aus Drohnen</translation>
    </message>
    <message>
        <source>Replace imagery by a photo map</source>
        <translation>Bilddaten durch eine Fotokarte ersetzen</translation>
    </message>
    <message>
        <source>&amp;Above it: the new map is a layer of its own, the old one stays, unticked</source>
        <translation>&amp;Darüber: die neue Karte ist ein eigener Layer, der alte bleibt, nicht angehakt</translation>
    </message>
    <message>
        <source>&amp;In it: the layer itself shows the new map, in layouts and themes too</source>
        <translation>D&amp;arin: der Layer selbst zeigt die neue Karte, auch in Layouts und Themen</translation>
    </message>
    <message>
        <source>&amp;Stale layer</source>
        <translation>&amp;Veralteter Layer</translation>
    </message>
    <message>
        <source>&amp;Piece</source>
        <translation>&amp;Teil</translation>
    </message>
    <message>
        <source>Choose the mission whose map is new: make one in the dock “Photo map”.</source>
        <translation>Wählen Sie die Mission, deren Karte neu ist: im Fenster „Fotokarte“ entsteht eine.</translation>
    </message>
    <message>
        <source>This map has no place on Earth yet: pick two points of it in the dock “Georeference” first.</source>
        <translation>Diese Karte hat noch keinen Ort auf der Erde: wählen Sie zuerst zwei Punkte im Fenster „Georeferenzieren“.</translation>
    </message>
    <message>
        <source>There is no raster layer to replace in this project: add the stale imagery first.</source>
        <translation>In diesem Projekt ist kein Rasterlayer zu ersetzen: fügen Sie zuerst die veralteten Bilddaten hinzu.</translation>
    </message>
    <message>
        <source>The replaced layer has been removed from the project: nothing can be put back.</source>
        <translation>Der ersetzte Layer wurde aus dem Projekt entfernt: nichts kann zurückgelegt werden.</translation>
    </message>
    <message>
        <source>“{}” takes the place of “{}”.</source>
        <translation>„{}“ nimmt den Platz von „{}“ ein.</translation>
    </message>
    <message>
        <source>“{}” shows the new map.</source>
        <translation>„{}“ zeigt die neue Karte.</translation>
    </message>
    <message>
        <source>The layer “{}” is not in the layer tree: add it there first.</source>
        <translation>Der Layer „{}“ ist nicht im Layerbaum: zuerst dort hinzufügen.</translation>
    </message>
    <message>
        <source>{} cannot be shown: make the map again.</source>
        <translation>{} kann nicht gezeigt werden: erstellen Sie die Karte neu.</translation>
    </message>
    <message>
        <source>registered</source>
        <translation>registriert</translation>
    </message>
    <message>
        <source>placed by GPS alone</source>
        <translation>nur durch GPS platziert</translation>
    </message>
    <message>
        <source>not shown in the map</source>
        <translation>nicht in der Karte gezeigt</translation>
    </message>
    <message>
        <source>no change</source>
        <translation>keine Änderung</translation>
    </message>
    <message>
        <source>changed</source>
        <translation>geändert</translation>
    </message>
    <message>
        <source>coarser: no person would show</source>
        <translation>gröber: keine Person wäre zu sehen</translation>
    </message>
    <message>
        <source>more</source>
        <translation>mehr</translation>
    </message>
    <message>
        <source>{} cm or finer</source>
        <translation>{} cm oder feiner</translation>
    </message>
    <message>
        <source>{} m: a person, just</source>
        <translation>{} m: eine Person, gerade noch</translation>
    </message>
</context>
</TS>
