// What stereocalib adds to viser's page.
import './link.js';
import './docking.js';
import './timeline.js';
import './picture.js';
import './shelf.js';
import './address.js';
import './keys.js';
import './phone.js';
