import sys,math
fn=sys.argv[1]; idx=[int(a) for a in sys.argv[2:]]
order=[];L={}
for l in open(fn):
    w=l.split(None,2)
    if not w: continue
    if w[0]=='Y' and w[1] not in order: order.append(w[1])
    if w[0] in 'EP': L.setdefault(w[1],[]).append(l)
for i in idx:
    k=order[i-1];P=P0=None;n=-1;out=[];R=''
    base=(0,0,0)
    for l in L[k]:
        w=l.split(None,5)
        if w[0]=='P': P=tuple(map(float,l.split()[2:7]));P0=P0 or P
        elif w[3]=='Log' and len(w)>4 and w[4]=='RESTART': R='R'
        elif w[3]=='Log' and len(w)>4 and w[4]=='X':
            n+=1;x,y,h,g=map(float,w[5].split())
            dx,dy=P[1]-P0[1],P[2]-P0[2];c,s=math.cos(-P0[3]),math.sin(-P0[3])
            tx,ty,th=c*dx-s*dy,s*dx+c*dy,P[3]-P0[3]
            if R: base=(x-tx,y-ty,0)
            e=math.hypot(x-base[0]-tx,y-base[1]-ty);he=math.degrees((h-th+math.pi)%(2*math.pi)-math.pi)
            out.append('%s%.0f(%.1f,%.1f) e%.1f h%.0f g%d'%(R,float(w[2]),P[1],P[2],e,he,g));R=''
    print(i,k[-6:],'\n   '.join(['']+out))
